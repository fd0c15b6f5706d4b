// What lies behind the surface at edge pixels (rendering model §5, edge antialiasing): both passes again, over fragments
// deeper than what is kept.

// At an edge pixel what is kept there, as a comparable depth; elsewhere 0, behind which nothing is.
@group(2) @binding(1) var limit: texture_2d<f32>;

fn is_behind(position: vec4f, z: f32) -> bool {
    return comparable(z) < textureLoad(limit, vec2i(floor(position.xy)), 0).r;
}

fn behind_shows(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0 && is_behind(in.position, z);
}

fn behind_adds(in: AttributeVertex, z: f32) -> bool {
    return is_kept(in, z) && is_behind(in.position, z);
}
