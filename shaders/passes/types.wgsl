// Structs and constants of the passes' buffers. surfel-gpu fills the buffers at the offsets that the build script
// reflects. A segment is the part of an object's splats that shares a buffer. A record is a splat as set up for a tile,
// a region of the image that is drawn at a time. A cell is a square of a tile's pixels with its own list of splats,
// balls or Gaussians. Targets are the textures of a tile in which passes sum up its pixels. `planes` is the buffer of a
// tile's results.

// Filters (rendering model §4): values of Frame.filter_kind.
const FILTER_NONE: u32 = 0u;
const FILTER_CLAMP: u32 = 1u;
const FILTER_ADJUST: u32 = 2u;
const FILTER_PRINCIPAL: u32 = 3u;
const FILTER_EWA: u32 = 4u;

// Shaders (rendering model §5): values of Frame.shader_kind.
const SHADER_UNLIT: u32 = 0u;
const SHADER_PHONG: u32 = 1u;
const SHADER_NORMAL: u32 = 2u;
const SHADER_DEPTH: u32 = 3u;
const SHADER_TOON: u32 = 4u;
const SHADER_MATCAP: u32 = 5u;
const SHADER_EDL: u32 = 6u;
// Phong with the colour that the application's shader function computes (host_color.wgsl).
const SHADER_HOST: u32 = 7u;

// Number of samples along a side of a pixel, if edges are antialiased by samples (rendering model §5).
const SAMPLES_SIDE: u32 = 4u;

// Uniform of a frame, or of one tile of a frame that exceeds a texture. If passes read neighbouring pixels, the targets
// have a border around the shaded region, except at the image's edge.
struct Frame {
    projection: Projection,
    // Filter radius h in pixels; 0 for no filter.
    radius_px: f32,
    // One of FILTER_….
    filter_kind: u32,
    // Rotation from view to world axes, and its inverse.
    world_from_view: mat3x3f,
    view_from_world: mat3x3f,
    // First pixel of the targets in the image (column, row), and their size (columns, rows).
    origin_px: vec2i,
    size_px: vec2u,
    // The ray through the centre of the image's pixel i (column, row) has the slope (x/z, y/z) ray_start + i·ray_step.
    // In an orthographic projection this is the ray's (x, y) in view space.
    ray_start: vec2f,
    ray_step: vec2f,
    // Ambient light, linear RGB.
    ambient: vec3f,
    // Kernel cutoff c.
    cutoff: f32,
    // Background colour, linear and premultiplied.
    background: vec4f,
    // Ambient, diffuse and specular factor and shininess, if all objects share them (has_materials is 0).
    material: vec4f,
    // Unit direction to the eye of an orthographic view, in world axes.
    to_eye: vec3f,
    // One of SHADER_….
    shader_kind: u32,
    // Depth of an empty pixel: +∞, which WGSL has no literal for.
    empty_depth: f32,
    // 1 if footprints are projective (exact mapping in perspective), 0 if they are affine.
    projective: u32,
    // 1 if the sums of attributes include colours (else all splats are white); 1 if they include material factors.
    has_colors: u32,
    has_materials: u32,
    // Number of lights in `lights`.
    light_count: u32,
    // 1 if edges are antialiased by coverage (rendering model §5).
    has_edges: u32,
    // Number of texels along a side of a shadow map, and index of the first texel of the map that this frame draws, if
    // it draws one.
    shadow_side: u32,
    shadow_at: u32,
    // 1 if the frame has polygons; 1 if it draws outlines where depth steps back (shader `toon`); 1 if it has eye-dome
    // lighting (shader `edl`).
    has_polygons: u32,
    has_outlines: u32,
    has_eye_dome: u32,
    // 1 if the frame has balls.
    has_balls: u32,
    // Coverage from which on splats fully cover a polygon behind them: 0.633 (rendering model §6).
    full_coverage: f32,
    // 1 if transparent splats are drawn in layers, by depth peeling or in an A-buffer; their records then store alpha
    // in place of the coverage. 1 if the layers are those of an A-buffer; records then also store the filter's area
    // ratio, if the filter has one, in place of the weight's factor.
    has_layers: u32,
    has_abuffer: u32,
    // 1 if the last layer has all remaining splats, lit one by one.
    has_remaining_layer: u32,
    // 1 if clip curves are replaced by their chords, the straight lines between their ends.
    clip_by_chord: u32,
    // Unit in which depths are summed, in world units: a power of two near the farthest depth, since sums may be f16,
    // which ends at 65504.
    depth_unit: f32,
    // Reciprocal of depth_unit, since a GPU's division rounds.
    per_depth_unit: f32,
    // Offsets in `planes`, in words, of the planes of colour, Z, normal, weight, fragment count, nearest splat (draw
    // and record), alpha, median depth and distortion, in this order. ABSENT for planes that aren't requested.
    color_at: u32,
    depth_at: u32,
    normal_at: u32,
    weight_at: u32,
    fragments_at: u32,
    nearest_at: u32,
    alpha_at: u32,
    median_depth_at: u32,
    distortion_at: u32,
    // For trained Gaussians: number of cells in a row of the tile; 1 if their colours are linear; smallest depth that
    // is drawn, in world units.
    gaussian_columns: u32,
    has_linear_gaussians: u32,
    gaussian_near: f32,
    // Offset of the pixels' states in `gaussian_lists`, in words, or ABSENT; maximum number of fragments of a pixel
    // that wait to be blended; background in the Gaussians' colour space, premultiplied.
    gaussian_states_at: u32,
    gaussian_room: u32,
    gaussian_background: vec4f,
    // First pixel (column, row) of the shaded region, relative to the targets, and the region's size.
    shade_origin_px: vec2u,
    shade_size_px: vec2u,
    // 1 in a frame of samples: a part of the image four times as wide and high, whose pixels are the samples of a
    // tile's edge pixels. The shaded region is then that of the tile of pixels, to whose planes the samples' means are
    // written.
    is_of_samples: u32,
    // In a frame of samples: size of the targets of the tile of pixels, and the pixel of these targets that the first
    // sample belongs to.
    pixels_size_px: vec2u,
    first_pixel: vec2u,
    // Numbers x and y of the embedding application's depth buffer, which stores x + y/z (perspective) or x + y·z
    // (orthographic) for the depth z.
    host_depth: vec2f,
    // For the compute path (cells.wgsl): number of cells in a row and in all; number of header words before the lists
    // of cells; number of chunks that may touch the tile; number of groups of records; capacity of
    // the buffers in records, in pairs of a record and a bin, and in pairs of a record and a cell.
    cell_columns: u32,
    cell_count: u32,
    cell_header: u32,
    cell_chunk_count: u32,
    cell_group_count: u32,
    cell_record_room: u32,
    cell_bin_pair_room: u32,
    cell_pair_room: u32,
    // In a frame of samples in the compute path: maximum number of active cells, those with a sampled pixel. 0 in other
    // frames.
    cell_active_room: u32,
    // Index of the frame's element in `cell_counters`: 0 for the tile of pixels, from 1 on for the frames of its
    // samples.
    cell_part: u32,
    // Offsets in `planes`, in words, of the data that the compute path's passes over neighbours and layers read:
    // normals and depths of surfaces, and edge data (cell_neighbours.wgsl). ABSENT without such passes.
    surfaces_at: u32,
    edges_at: u32,
    // Offset in `planes`, in words, of the layers of pixels and cells (cell_layers.wgsl). ABSENT without layers.
    layers_at: u32,
    // Offset in `planes`, in words, of samples with layers (cell_layers.wgsl), in a frame of samples.
    samples_at: u32,
    // A uniform buffer aligns structs to 16 bytes.
    @align(16) tolerance: Tolerance,
}

// Offset or index of something that doesn't exist.
const ABSENT: u32 = 0xffffffffu;

// An object of the scene, as the passes need it.
struct Object {
    // Matrix from object to view directions.
    linear: mat3x3f,
    // Matrix from normals in object space to outward normals in world space, up to scale.
    normals: mat3x3f,
    // Ambient, diffuse and specular factor, shininess.
    material: vec4f,
    // 1 if back-facing splats are skipped; 1 if back-facing splats are lit with the reverse of their shading normal.
    cull_back: u32,
    two_sided: u32,
    // Coverage of a unit of weight: 1/W0 at the frame's cutoff, with W0 the interior weight of the object's cloud
    // (rendering model §5). 1 if W0 is unknown.
    coverage: f32,
    // 1 if the cloud is oriented: all outward normals point out of the same surface. 1 if, in addition, the frame
    // separates the front and back side of that surface.
    oriented: u32,
    keeps_facings: u32,
}

// Up to 256 splats that the CPU culls together. Their positions are relative to one origin.
struct Chunk {
    // View position of the origin.
    center: vec3f,
    // CHUNK_OUTSIDE, CHUNK_ORDINARY, or the index in `near_bits` of the first word with the bits of the chunk's splats.
    state: u32,
}

// State of a chunk if none of its splats can touch the tile.
const CHUNK_OUTSIDE: u32 = 0xffffffffu;
// State of a chunk if none of its splats reaches the near plane.
const CHUNK_ORDINARY: u32 = 0xfffffffeu;
// Maximum number of splats of a chunk.
const CHUNK_SPLATS: u32 = 256u;

// The part of an object's splats that shares a buffer, and the layout of a splat in this buffer, `splats`.
struct Segment {
    // Index of the object in `objects`.
    object: u32,
    // Number of splats.
    count: u32,
    // Distance from one splat to the next in `splats`. It and the offsets below, which are those of fields within a
    // splat, are in words, or in half-words if splats are quantised to 16 bits.
    stride: u32,
    // 1 if the shape is the normal and radius of a disk, 0 if it is the half-axes s and t of an ellipse.
    is_disk: u32,
    center_at: u32,
    shape_at: u32,
    // Each is ABSENT if the splats don't have that attribute.
    color_at: u32,
    shading_normal_at: u32,
    // Offset of the clip in segments of clipped splats, else ABSENT.
    clip_at: u32,
    // Offset of alpha in segments of transparent splats, else ABSENT.
    alpha_at: u32,
    // Offset in words, from the beginning of `splats`, of the scales of quantised splats: three per chunk. ABSENT if
    // splats are f32.
    scales_at: u32,
    // 1 if the embedding application places the splats (place_splats.wgsl). They are then one chunk, whose origin is
    // that of the object.
    is_placed: u32,
}

// Code of a splat that isn't drawn because the application has given it no valid place. A splat's code is its first
// word: its chunk times CHUNK_SPLATS, plus its index in the chunk.
const SPLAT_HIDDEN: u32 = 0xffffffffu;

// Number of invocations of the workgroups that process one splat per invocation.
const WORKGROUP: u32 = 64u;

// A splat as set up for a tile. Its linear forms are over pixel offsets from an anchor, the pixel position base +
// fraction, which usually is the projected centre. (u, v) is the position on the splat's unit disk, and w is 1/z up to
// a factor, or 1 for an affine footprint.
struct Record {
    // Integer and fractional part of the anchor, in pixels of the image.
    base: vec2i,
    fraction: vec2f,
    // Change of the unfiltered u·w and v·w per pixel to the right and down.
    visible_u: vec2f,
    visible_v: vec2f,
    // Change of the plane's depth form per pixel to the right and down, and the form's scale (see DepthPlane).
    depth: vec2f,
    scale: f32,
    // Depth tolerance ε in world units.
    epsilon: f32,
    // Smallest and largest value over the disk: of the depth form's denominator with RECORD_RECIPROCAL, else of z.
    range: vec2f,
    // Factor of the kernel's weight (see Filtered).
    weight_scale: f32,
    // RECORD_… flags; the object's index begins at bit RECORD_OBJECT.
    flags: u32,
    // Change of the filtered u·w, v·w and w per pixel to the right and down.
    u: vec2f,
    v: vec2f,
    w: vec2f,
    // u·w and v·w at the anchor; 0 unless the CPU set up the splat because it reaches the near plane.
    at_anchor: vec2f,
    // Linear albedo.
    color: vec3f,
    // w at the anchor; 1 unless the CPU set up the splat because it reaches the near plane.
    w_at_anchor: f32,
    // Shading normal in world axes, turned to the eye if the material is two-sided.
    normal: vec3f,
    // Coverage of a unit of weight: the filter's area ratio over the interior weight W0 (rendering model §5). Alpha
    // instead, if transparent splats are drawn in layers.
    coverage: f32,
    // Boxes of the pixels, relative to the targets, that the unfiltered and the filtered footprint may touch: first
    // column | first row << 16, end column | end row << 16. Ends are one past the last; (0, 0) is an empty box.
    visible_box: vec2u,
    filtered_box: vec2u,
}

// Clips of a splat's unfiltered (`visible`) and filtered footprint, as forms over pixel offsets from the record's
// anchor.
struct RecordClip {
    visible: Clip,
    filtered: Clip,
}

// Record flag: the depth form is the denominator of z (DEPTH_RECIPROCAL). Without the flag it is z itself
// (DEPTH_LINEAR).
const RECORD_RECIPROCAL: u32 = 1u;
// Record flag: the filtered footprint includes the disk of the filter `clamp`.
const RECORD_CLAMP: u32 = 2u;
// Record flag: the fields visible_u and visible_v store the view position of the splat's centre instead of gradients.
const RECORD_CENTERED: u32 = 4u;
// Record flags: the splat belongs to an oriented cloud whose sides are separated, and is front-facing (RECORD_FRONT) or
// back-facing (RECORD_BACK).
const RECORD_FRONT: u32 = 8u;
const RECORD_BACK: u32 = 16u;
// Record flag: the record has clips. Only set in the compute path, which draws splats with and without clips in the
// same passes.
const RECORD_CLIPPED: u32 = 32u;
// Record flag: the splat is transparent and drawn in layers.
const RECORD_LAYERED: u32 = 64u;
// Number of the bit of Record.flags at which the index of the splat's object begins.
const RECORD_OBJECT: u32 = 7u;

// A light of the scene.
struct Light {
    // Position relative to the eye, in world axes. Unused for directional lights.
    position: vec3f,
    // One of LIGHT_….
    kind: u32,
    // Unit direction in which the light travels, in world axes. Unused for point lights.
    direction: vec3f,
    // Half-angle up to which a spot has its full strength, in radians; `outer` is the half-angle from which on it gives
    // no light.
    inner: f32,
    color: vec3f,
    outer: f32,
    // Index of the light's first shadow map, and number of maps.
    first_map: u32,
    map_count: u32,
}

// Kinds of lights.
const LIGHT_DIRECTIONAL: u32 = 0u;
const LIGHT_POINT: u32 = 1u;
const LIGHT_SPOT: u32 = 2u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> objects: array<Object>;
@group(0) @binding(2) var<storage, read> lights: array<Light>;
