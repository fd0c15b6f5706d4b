// Kernels that each do one kind of work as fast as the device can. No image needs them, so they aren't among the
// renderer's shaders.

const WORKGROUP: u32 = 256u;
// Fused multiply-adds of a lane in the arithmetic kernels: ROUNDS times four vectors of four lanes.
const ROUNDS: u32 = 256u;

@group(0) @binding(0) var<storage, read> source: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> sink: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> counters: array<atomic<u32>>;

fn invocation(id: vec3u, groups: vec3u) -> u32 {
    return id.y * groups.x * WORKGROUP + id.x;
}

@compute @workgroup_size(WORKGROUP)
fn memory_copy(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = invocation(id, groups);
    if i < arrayLength(&source) {
        sink[i] = source[i];
    }
}

@compute @workgroup_size(WORKGROUP)
fn memory_write(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = invocation(id, groups);
    if i < arrayLength(&sink) {
        sink[i] = vec4f(f32(i), 1.0, 2.0, 3.0);
    }
}

// Number of vectors that every invocation reads, far apart from each other; it writes their sum.
const READS: u32 = 64u;

@compute @workgroup_size(WORKGROUP)
fn memory_read(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = invocation(id, groups);
    let apart = arrayLength(&source) / READS;
    if i < apart {
        var sum = vec4f(0.0, 0.0, 0.0, 0.0);
        for (var k = 0u; k < READS; k++) {
            sum += source[k * apart + i];
        }
        sink[i] = sum;
    }
}

// Computes four independent chains of fused multiply-adds. The factors come from memory, so that no compiler folds
// them.
fn arithmetic(seed: f32) -> vec4f {
    let factor = source[0];
    let term = source[1];
    var a = vec4f(seed, seed + 0.25, seed + 0.5, seed + 0.75);
    var b = a + 1.0;
    var c = a + 2.0;
    var d = a + 3.0;
    for (var round = 0u; round < ROUNDS; round++) {
        a = fma(a, factor, term);
        b = fma(b, factor, term);
        c = fma(c, factor, term);
        d = fma(d, factor, term);
    }
    return a + b + c + d;
}

@compute @workgroup_size(WORKGROUP)
fn arithmetic_compute(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = invocation(id, groups);
    if i < arrayLength(&sink) {
        sink[i] = arithmetic(f32(i % 1024u) / 1024.0);
    }
}

// Computes maxima at pseudorandom positions, like the pixels of scattered splats.
@compute @workgroup_size(WORKGROUP)
fn atomic_maxima(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = invocation(id, groups);
    let place = (i * 2654435761u) % arrayLength(&counters);
    atomicMax(&counters[place], i);
}

struct Fragment {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) seed: f32,
}

// Draws triangles that cover the target.
@vertex
fn full_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Fragment {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return Fragment(vec4f(corner * 2.0 - 1.0, 0.0, 1.0), f32(instance % 16u) / 16.0);
}

@fragment
fn arithmetic_fragment(in: Fragment) -> @location(0) vec4f {
    return arithmetic(in.seed + in.position.x / 4096.0);
}

// Side of the target in pixels.
const SIDE: u32 = 1024u;

// Returns corner `corner`, 0 to 3, of the quad with number `quad`. The quad covers one pixel at a pseudorandom
// position.
fn quad_corner(quad: u32, corner: u32) -> Fragment {
    let place = (quad * 2654435761u) % (SIDE * SIDE);
    let pixel = vec2f(f32(place % SIDE), f32(place / SIDE));
    let offset = vec2f(f32(corner & 1u), f32(corner >> 1u));
    return Fragment(vec4f((pixel + offset) * (2.0 / f32(SIDE)) - 1.0, 0.0, 1.0), f32(quad & 255u) / 255.0);
}

// Draws one quad per instance, as strips of four vertices.
@vertex
fn strip_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Fragment {
    return quad_corner(instance, vertex);
}

// Draws all quads in one draw, with six vertices each.
@vertex
fn list_vertex(@builtin(vertex_index) vertex: u32) -> Fragment {
    let corner = vertex % 6u;
    return quad_corner(vertex / 6u, select(corner, corner - 2u, corner > 2u));
}

@fragment
fn plain_fragment(in: Fragment) -> @location(0) vec4f {
    return vec4f(in.seed, 0.0, 0.0, 1.0);
}
