// Structs and constants of the passes' buffers. surfel-gpu fills these by the offsets that the build script reflects.

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

// Samples along a pixel's side, where edges are antialiased by samples (§5).
const SAMPLES_SIDE: u32 = 4u;

// A frame, or one tile of it where it doesn't fit into a texture. Where edges are antialiased, targets have a border of
// one pixel more than what is shaded, for neighbours.
struct Frame {
    projection: Projection,
    // h, pixels; 0 for no filter.
    radius_px: f32,
    // FILTER_….
    filter_kind: u32,
    // Rotation of view axes to world axes, and back.
    world_from_view: mat3x3f,
    view_from_world: mat3x3f,
    // First pixel and size of the targets.
    origin_px: vec2i,
    size_px: vec2u,
    // Slope (orthographic: offset) of the ray through the centre of pixel i: start + i·step.
    ray_start: vec2f,
    ray_step: vec2f,
    // Ambient light.
    ambient: vec3f,
    // Kernel cutoff c.
    cutoff: f32,
    // Linear, premultiplied.
    background: vec4f,
    // Ambient, diffuse, specular, shininess where all objects share them.
    material: vec4f,
    // Toward the eye of an orthographic view, world axes.
    to_eye: vec3f,
    // SHADER_….
    shader_kind: u32,
    // Depth of an empty pixel: +∞, for which WGSL has no literal.
    empty_depth: f32,
    // Footprints are projective: exact mapping in perspective.
    projective: u32,
    // The sums have colours, material factors.
    has_colors: u32,
    has_materials: u32,
    light_count: u32,
    // Edges are antialiased.
    has_edges: u32,
    // Texels on a side of a shadow map, and where a map that is drawn starts.
    shadow_side: u32,
    shadow_at: u32,
    // The frame has polygons, outlines (where depth steps back), eye-dome lighting.
    has_polygons: u32,
    has_outlines: u32,
    has_eye_dome: u32,
    // Coverage from which splats occlude a polygon behind them.
    full_coverage: f32,
    // Transparent splats are drawn in layers, and records of them hold alpha in place of the coverage; those of an
    // A-buffer have its area ratio, where a filter gives one, in place of the weight's factor.
    has_layers: u32,
    has_abuffer: u32,
    // Clip curves are taken for their chords.
    clip_by_chord: u32,
    // Depths are summed in this unit, a power of two about as large as the farthest: f16 ends at 65504.
    depth_unit: f32,
    // Its reciprocal, for a GPU's division rounds.
    per_depth_unit: f32,
    // First value of each plane in `planes`, or ABSENT.
    color_at: u32,
    depth_at: u32,
    normal_at: u32,
    weight_at: u32,
    fragments_at: u32,
    nearest_at: u32,
    alpha_at: u32,
    median_depth_at: u32,
    distortion_at: u32,
    // Of trained Gaussians: cells in a row, whether colours are linear, where views begin, and what lies behind them in
    // their colour space, premultiplied.
    gaussian_columns: u32,
    has_linear_gaussians: u32,
    gaussian_near: f32,
    // Where the states of pixels are among the lists of Gaussians, or ABSENT, and how many fragments a pixel has room
    // for.
    gaussian_states_at: u32,
    gaussian_room: u32,
    gaussian_background: vec4f,
    // First pixel, counted within the targets, and size of what is shaded.
    shade_origin_px: vec2u,
    shade_size_px: vec2u,
    // The targets hold samples of pixels at edges, and the tile of those pixels has the two above, which are planes'.
    is_of_samples: u32,
    // Of the targets of that tile: their size, and the pixel that the first sample belongs to.
    pixels_size_px: vec2u,
    first_pixel: vec2u,
    // A host's depth buffer holds x + y/z (perspective), or x + y·z (orthographic).
    host_depth: vec2f,
    // Of the compute path: cells in a row, and in all, chunks that may touch the tile, groups of records, and how many
    // records and pairs there is room for.
    cell_columns: u32,
    cell_count: u32,
    cell_chunk_count: u32,
    cell_group_count: u32,
    cell_record_room: u32,
    cell_pair_room: u32,
    // Where `planes` hold the surfaces that passes over neighbours look at, or ABSENT.
    surfaces_at: u32,
    // A uniform buffer aligns structs so.
    @align(16) tolerance: Tolerance,
}

const ABSENT: u32 = 0xffffffffu;

struct Object {
    // Object to view directions.
    linear: mat3x3f,
    // Object to world normals up to scale, turned outside-out.
    normals: mat3x3f,
    // Ambient, diffuse, specular, shininess.
    material: vec4f,
    // Back-facing splats are left out; show the reverse of their shading normal.
    cull_back: u32,
    two_sided: u32,
    // Coverage of a unit of weight: 1/W0 at the frame's cutoff.
    coverage: f32,
    // Its normals all point out of the same surface, and the frame keeps that surface's sides apart.
    oriented: u32,
    keeps_facings: u32,
}

// Up to 256 splats about one origin.
struct Chunk {
    // View position of the origin.
    center: vec3f,
    // CHUNK_OUTSIDE, CHUNK_ORDINARY, or where its splats' bits in `near_bits` start.
    state: u32,
}

// No splat of the chunk can touch the tile.
const CHUNK_OUTSIDE: u32 = 0xffffffffu;
// None of its splats reaches the near plane.
const CHUNK_ORDINARY: u32 = 0xfffffffeu;
// Splats of a chunk, at most.
const CHUNK_SPLATS: u32 = 256u;

// A part of an object's splats that one buffer holds.
struct Segment {
    // Index of the object.
    object: u32,
    // Number of splats.
    count: u32,
    // Length of a splat in `splats`: words, or halves of them where splats are in 16 bits. So are the places below
    // counted.
    stride: u32,
    // Its shape is normal and radius of a disk, or s and t.
    is_disk: u32,
    center_at: u32,
    shape_at: u32,
    // ABSENT where splats have none.
    color_at: u32,
    shading_normal_at: u32,
    // Only of segments of clipped splats.
    clip_at: u32,
    // Only of segments of transparent splats.
    alpha_at: u32,
    // Word in `splats` from which on the chunks' scales are; ABSENT where splats are f32.
    scales_at: u32,
}

const WORKGROUP: u32 = 64u;

// A splat on the screen. Forms are about the anchor, base + fraction.
struct Record {
    // Whole pixels of the anchor, and what remains of it.
    base: vec2i,
    fraction: vec2f,
    // Gradients of the unfiltered (u·w, v·w).
    visible_u: vec2f,
    visible_v: vec2f,
    // Gradient of the plane's depth form, and the form's scale (see DepthPlane).
    depth: vec2f,
    scale: f32,
    // ε.
    epsilon: f32,
    // Range of the depth form over the disk: of w, or of z.
    range: vec2f,
    // Factor of the weight.
    weight_scale: f32,
    // RECORD_… flags; the object's index from RECORD_OBJECT on.
    flags: u32,
    // Gradients of the filtered (u·w, v·w, w).
    u: vec2f,
    v: vec2f,
    w: vec2f,
    // u·w, v·w at the anchor; 0 for an ordinary splat.
    at_anchor: vec2f,
    // Linear albedo.
    color: vec3f,
    // w at the anchor; 1 for an ordinary splat.
    w_at_anchor: f32,
    // World shading normal, turned to the eye where the material is two-sided.
    normal: vec3f,
    // Coverage of a unit of weight, a/W0; where transparent splats are layers of their own, their alpha.
    coverage: f32,
    // Pixels of the tile that the unfiltered and the filtered footprint may touch: first column | first row << 16, end
    // column | end row << 16.
    visible_box: vec2u,
    filtered_box: vec2u,
}

// Clips of a splat's two footprints, about the record's anchor.
struct RecordClip {
    visible: Clip,
    filtered: Clip,
}

// The depth form is that of 1/z, else of z.
const RECORD_RECIPROCAL: u32 = 1u;
// The disk of `clamp` belongs to the filtered footprint.
const RECORD_CLAMP: u32 = 2u;
// In place of the gradients of the unfiltered (u·w, v·w) is the view position of the centre.
const RECORD_CENTERED: u32 = 4u;
// The splat is front-facing, or back-facing, of an oriented cloud whose sides are kept apart.
const RECORD_FRONT: u32 = 8u;
const RECORD_BACK: u32 = 16u;
const RECORD_OBJECT: u32 = 5u;

struct Light {
    // Relative to the eye, world axes.
    position: vec3f,
    // LIGHT_….
    kind: u32,
    // Unit, where the light travels.
    direction: vec3f,
    // Half-angles of a spot, radians.
    inner: f32,
    color: vec3f,
    outer: f32,
    // Its shadow maps.
    first_map: u32,
    map_count: u32,
}

const LIGHT_DIRECTIONAL: u32 = 0u;
const LIGHT_POINT: u32 = 1u;
const LIGHT_SPOT: u32 = 2u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> objects: array<Object>;
@group(0) @binding(2) var<storage, read> lights: array<Light>;
