// Structs and constants of the passes' buffers. surfel-gpu fills them at the offsets that the build script reflects. A
// segment is the part of an object's splats that shares a buffer. A record is a splat as set up for a tile. A cell is a
// square of a tile's pixels with its own list of splats, balls or Gaussians.

// Filters (rendering model §4).
const FILTER_NONE: u32 = 0u;
const FILTER_CLAMP: u32 = 1u;
const FILTER_ADJUST: u32 = 2u;
const FILTER_PRINCIPAL: u32 = 3u;
const FILTER_EWA: u32 = 4u;

// Shaders (§5).
const SHADER_UNLIT: u32 = 0u;
const SHADER_PHONG: u32 = 1u;
const SHADER_NORMAL: u32 = 2u;
const SHADER_DEPTH: u32 = 3u;
const SHADER_TOON: u32 = 4u;
const SHADER_MATCAP: u32 = 5u;
const SHADER_EDL: u32 = 6u;
// Phong with the colour that the application's shader function computes (host_color.wgsl).
const SHADER_HOST: u32 = 7u;

// Samples along a side of a pixel, if edges are antialiased by samples (§5).
const SAMPLES_SIDE: u32 = 4u;

// Uniform of a frame, or of one tile of a frame that exceeds a texture. If edges are antialiased, the targets have a
// border of one pixel around the shaded region, for neighbours.
struct Frame {
    projection: Projection,
    // Filter radius h in pixels; 0 for no filter.
    radius_px: f32,
    // One of FILTER_….
    filter_kind: u32,
    // Rotations from view to world axes, and back.
    world_from_view: mat3x3f,
    view_from_world: mat3x3f,
    // First pixel and size of the targets.
    origin_px: vec2i,
    size_px: vec2u,
    // Slope (orthographic: offset) of the ray through the centre of pixel i: ray_start + i·ray_step.
    ray_start: vec2f,
    ray_step: vec2f,
    // Ambient light.
    ambient: vec3f,
    // Kernel cutoff c.
    cutoff: f32,
    // Background colour, linear and premultiplied.
    background: vec4f,
    // Ambient, diffuse and specular factor and shininess, if all objects share them.
    material: vec4f,
    // Direction to the eye of an orthographic view, world axes.
    to_eye: vec3f,
    // One of SHADER_….
    shader_kind: u32,
    // Depth of an empty pixel: +∞, for which WGSL has no literal.
    empty_depth: f32,
    // 1 if footprints are projective: exact mapping in perspective.
    projective: u32,
    // 1 if the sums include colours, or material factors.
    has_colors: u32,
    has_materials: u32,
    light_count: u32,
    // 1 if edges are antialiased.
    has_edges: u32,
    // Texels on a side of a shadow map, and offset of the map being drawn.
    shadow_side: u32,
    shadow_at: u32,
    // 1 if the frame has polygons, outlines (at depth steps), or eye-dome lighting.
    has_polygons: u32,
    has_outlines: u32,
    has_eye_dome: u32,
    // 1 if the frame has balls.
    has_balls: u32,
    // Coverage from which on splats occlude a polygon behind them.
    full_coverage: f32,
    // 1 if transparent splats are drawn in layers; their records then store alpha in place of the coverage. In an
    // A-buffer (has_abuffer), records store the area ratio of a filter, if it has one, in place of the weight's factor.
    has_layers: u32,
    has_abuffer: u32,
    // 1 if clip curves are replaced by their chords.
    clip_by_chord: u32,
    // Unit of summed depths, a power of two near the farthest depth: f16 ends at 65504.
    depth_unit: f32,
    // Reciprocal of depth_unit, since a GPU's division rounds.
    per_depth_unit: f32,
    // Offset of each plane in `planes`, or ABSENT.
    color_at: u32,
    depth_at: u32,
    normal_at: u32,
    weight_at: u32,
    fragments_at: u32,
    nearest_at: u32,
    alpha_at: u32,
    median_depth_at: u32,
    distortion_at: u32,
    // For trained Gaussians: number of cells in a row, 1 if colours are linear, and least depth that is drawn.
    gaussian_columns: u32,
    has_linear_gaussians: u32,
    gaussian_near: f32,
    // Offset of the pixels' states in `gaussian_lists`, or ABSENT; maximum number of waiting fragments per pixel;
    // background in the Gaussians' colour space, premultiplied.
    gaussian_states_at: u32,
    gaussian_room: u32,
    gaussian_background: vec4f,
    // First pixel, relative to the targets, and size of the shaded region.
    shade_origin_px: vec2u,
    shade_size_px: vec2u,
    // 1 if the targets contain samples of edge pixels. The shaded region is then that of the tile of pixels, whose
    // planes are written.
    is_of_samples: u32,
    // For samples: size of the targets of the tile of pixels, and the pixel that the first sample belongs to.
    pixels_size_px: vec2u,
    first_pixel: vec2u,
    // The depth buffer of the embedding application stores x + y/z (perspective) or x + y·z (orthographic).
    host_depth: vec2f,
    // For the compute path: number of cells in a row and in all, of elements before the pairs in a buffer of pairs, of
    // chunks that may touch the tile, and of groups of records; capacity of the buffers in records and pairs.
    cell_columns: u32,
    cell_count: u32,
    cell_header: u32,
    cell_chunk_count: u32,
    cell_group_count: u32,
    cell_record_room: u32,
    cell_pair_room: u32,
    // For samples in the compute path: maximum number of active cells; otherwise 0.
    cell_active_room: u32,
    // Index of the tile's counters: 0 for pixels, then the parts of their samples.
    cell_part: u32,
    // Offsets in `planes` of the surfaces and of the edge data that passes over neighbours read, or ABSENT.
    surfaces_at: u32,
    edges_at: u32,
    // A uniform buffer aligns structs to 16 bytes.
    @align(16) tolerance: Tolerance,
}

const ABSENT: u32 = 0xffffffffu;

struct Object {
    // Matrix from object to view directions.
    linear: mat3x3f,
    // Matrix from object to world normals up to scale, which point outwards.
    normals: mat3x3f,
    // Ambient, diffuse and specular factor, shininess.
    material: vec4f,
    // 1 if back-facing splats are skipped; 1 if they show the reverse of their shading normal.
    cull_back: u32,
    two_sided: u32,
    // Coverage of a unit of weight: 1/W0 at the frame's cutoff.
    coverage: f32,
    // 1 if all normals point out of the same surface; 1 if the frame also separates the sides of that surface.
    oriented: u32,
    keeps_facings: u32,
}

// Up to 256 splats about one origin.
struct Chunk {
    // View position of the origin.
    center: vec3f,
    // CHUNK_OUTSIDE, CHUNK_ORDINARY, or the position of its splats' bits in `near_bits`.
    state: u32,
}

// State of a chunk if none of its splats can touch the tile.
const CHUNK_OUTSIDE: u32 = 0xffffffffu;
// State of a chunk if none of its splats reaches the near plane.
const CHUNK_ORDINARY: u32 = 0xfffffffeu;
// Maximum number of splats of a chunk.
const CHUNK_SPLATS: u32 = 256u;

// Splats of an object that one buffer holds.
struct Segment {
    // Index of the object.
    object: u32,
    // Number of splats.
    count: u32,
    // Length of a splat in `splats`. It and the offsets below are in words, or in half-words if splats are quantised to
    // 16 bits.
    stride: u32,
    // 1 if the shape is the normal and radius of a disk, 0 if it is the axes s and t.
    is_disk: u32,
    center_at: u32,
    shape_at: u32,
    // ABSENT if splats have no colours, or no shading normals.
    color_at: u32,
    shading_normal_at: u32,
    // Only in segments of clipped splats.
    clip_at: u32,
    // Only in segments of transparent splats.
    alpha_at: u32,
    // Offset in words of the chunks' scales in `splats`; ABSENT if splats are f32.
    scales_at: u32,
    // 1 if the application places the splats (place_splats.wgsl). They are one chunk, whose origin is that of the
    // object.
    is_placed: u32,
}

// Code of a splat that isn't drawn because the application has placed it nowhere.
const SPLAT_HIDDEN: u32 = 0xffffffffu;

const WORKGROUP: u32 = 64u;

// A splat on the screen. Forms are relative to the anchor, base + fraction.
struct Record {
    // Integer and fractional part of the anchor in pixels.
    base: vec2i,
    fraction: vec2f,
    // Gradients of the unfiltered (u·w, v·w).
    visible_u: vec2f,
    visible_v: vec2f,
    // Gradient of the plane's depth form, and the form's scale (see DepthPlane).
    depth: vec2f,
    scale: f32,
    // Depth tolerance ε.
    epsilon: f32,
    // Range of the depth form over the disk: of w, or of z.
    range: vec2f,
    // Factor of the weight.
    weight_scale: f32,
    // RECORD_… flags; the object's index begins at bit RECORD_OBJECT.
    flags: u32,
    // Gradients of the filtered (u·w, v·w, w).
    u: vec2f,
    v: vec2f,
    w: vec2f,
    // u·w and v·w at the anchor; 0 for an ordinary splat.
    at_anchor: vec2f,
    // Linear albedo.
    color: vec3f,
    // w at the anchor; 1 for an ordinary splat.
    w_at_anchor: f32,
    // Shading normal in world axes, turned to the eye if the material is two-sided.
    normal: vec3f,
    // Coverage of a unit of weight, a/W0; the alpha, if transparent splats are drawn in layers.
    coverage: f32,
    // Boxes of the tile's pixels that the unfiltered and the filtered footprint may touch: first column | first row <<
    // 16, end column | end row << 16.
    visible_box: vec2u,
    filtered_box: vec2u,
}

// Clips of a splat's two footprints, relative to the record's anchor.
struct RecordClip {
    visible: Clip,
    filtered: Clip,
}

// The depth form is that of 1/z; without the flag that of z.
const RECORD_RECIPROCAL: u32 = 1u;
// The filtered footprint includes the disk of the filter `clamp`.
const RECORD_CLAMP: u32 = 2u;
// The gradients of the unfiltered (u·w, v·w) are replaced by the view position of the centre.
const RECORD_CENTERED: u32 = 4u;
// The splat is front-facing, or back-facing, and belongs to an oriented cloud whose sides are separated.
const RECORD_FRONT: u32 = 8u;
const RECORD_BACK: u32 = 16u;
// The record has clips. Only set in the compute path, which draws splats with and without clips in the same passes.
const RECORD_CLIPPED: u32 = 32u;
const RECORD_OBJECT: u32 = 6u;

struct Light {
    // Position relative to the eye, world axes.
    position: vec3f,
    // One of LIGHT_….
    kind: u32,
    // Unit direction in which the light travels.
    direction: vec3f,
    // Half-angle of a spot's full strength, radians; `outer` is that of its edge.
    inner: f32,
    color: vec3f,
    outer: f32,
    // Index of the light's first shadow map, and number of maps.
    first_map: u32,
    map_count: u32,
}

const LIGHT_DIRECTIONAL: u32 = 0u;
const LIGHT_POINT: u32 = 1u;
const LIGHT_SPOT: u32 = 2u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> objects: array<Object>;
@group(0) @binding(2) var<storage, read> lights: array<Light>;
