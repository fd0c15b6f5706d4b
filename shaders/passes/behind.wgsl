// What lies behind the surface at edge pixels (rendering model §5, edge antialiasing): both passes again, over fragments
// deeper than what is kept.

// At an edge pixel what is kept there, as a comparable depth; elsewhere 0, behind which nothing is.
@group(2) @binding(1) var limit: texture_2d<f32>;

fn is_behind(position: vec4f, z: f32) -> bool {
    return comparable(z) < textureLoad(limit, vec2i(floor(position.xy)), 0).r;
}

@fragment
fn behind_visibility_fragment(in: VisibilityVertex) -> @builtin(frag_depth) f32 {
    let z = visible_depth(in);
    if z <= 0.0 || !is_behind(in.position, z) {
        discard;
    }
    return comparable(z + in.anchor.w);
}

@fragment
fn behind_color_fragment(in: AttributeVertex) -> @location(0) vec4f {
    let c = contribution(in);
    if !c.is_there || !is_behind(in.position, c.z) {
        discard;
    }
    return vec4f(in.color, 1.0) * c.weight;
}

@fragment
fn behind_surface_fragment(in: AttributeVertex) -> SurfaceSums {
    let c = contribution(in);
    if !c.is_there || !is_behind(in.position, c.z) {
        discard;
    }
    return SurfaceSums(vec4f(in.color, 1.0) * c.weight, surface_of(in, c));
}

@fragment
fn behind_further_fragment(in: AttributeVertex) -> @location(0) vec4f {
    let c = contribution(in);
    if !c.is_there || !is_behind(in.position, c.z) {
        discard;
    }
    return objects[in.flags >> RECORD_OBJECT].material * c.weight;
}
