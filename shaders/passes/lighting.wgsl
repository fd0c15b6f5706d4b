// Terms of Phong's model (rendering model §5). Positions and directions are in world axes, positions relative to the
// eye.

// Unit vector to a light, and the light's colour at the lit point.
struct Incident {
    to_light: vec3f,
    color: vec3f,
}

// Returns the angle between unit vectors in radians, accurate for small angles and for those near π: 2·atan(|a − b|/|a
// + b|). The built-in arctangents may be off by 4096 ulp; this polynomial (Cephes, atanf) is accurate to 2 ulp.
fn angle_between(a: vec3f, b: vec3f) -> f32 {
    let y = v3_length(a - b);
    let x = v3_length(a + b);
    let t = min(x, y) / max(max(x, y), 1e-30);
    // Beyond t = tan(π/8), atan t is computed as π/4 + atan((t − 1)/(t + 1)).
    let is_beyond = t > 0.41421356;
    let r = select(t, (t - 1.0) / (t + 1.0), is_beyond);
    let q = r * r;
    let series = fma(fma(fma(0.080537446, q, -0.13877685), q, 0.19977710), q, -0.33332949);
    let angle = fma(series * q, r, r) + select(0.0, 0.78539816, is_beyond);
    return 2.0 * select(angle, 1.57079633 - angle, y > x);
}

// Returns a spot's strength at an angle from its axis: 1 up to `inner`, 0 from `outer` on, smoothstep in between.
// Angles are in radians.
fn spot_strength(angle: f32, inner: f32, outer: f32) -> f32 {
    if angle <= inner {
        return 1.0;
    }
    if angle >= outer {
        return 0.0;
    }
    let x = (outer - angle) / (outer - inner);
    return x * x * (3.0 - 2.0 * x);
}

// Returns the direction to a light from a position, and the light that arrives there, shadows ignored.
fn incident(light: Light, position: vec3f) -> Incident {
    if light.kind == LIGHT_DIRECTIONAL {
        return Incident(-light.direction, light.color);
    }
    let to_light = unit(light.position - position);
    if light.kind == LIGHT_POINT {
        return Incident(to_light, light.color);
    }
    let strength = spot_strength(angle_between(-to_light, light.direction), light.inner, light.outer);
    return Incident(to_light, light.color * strength);
}

// Returns base^exponent for a base in [0, 1]. 0⁰ is 1, as in all backends.
fn highlight(base: f32, exponent: f32) -> f32 {
    if exponent <= 0.0 {
        return 1.0;
    }
    return select(0.0, exp2(exponent * log2(max(base, 1e-37))), base > 0.0);
}

// Returns the colour of a surface: the sum of ambient, diffuse and specular light by Phong's model. `material` is
// ambient, diffuse and specular factor and shininess. With `full` (see `shade`) the colour includes shadows and the
// steps of `toon`.
fn lit(albedo: vec3f, normal: vec3f, position: vec3f, to_eye: vec3f, material: vec4f, full: bool) -> vec3f {
    let is_toon = full && frame.shader_kind == SHADER_TOON;
    var matte = frame.ambient * material.x;
    var gloss = vec3f(0.0, 0.0, 0.0);
    for (var i = 0u; i < frame.light_count; i++) {
        let light = incident(lights[i], position);
        let cosine = v3_dot(normal, light.to_light);
        if cosine > 0.0 {
            let reflected = normal * (2.0 * cosine) - light.to_light;
            let shine = highlight(clamp(v3_dot(reflected, to_eye), 0.0, 1.0), material.w);
            var share = 1.0;
            if full {
                share = light_visibility(lights[i], position, normal);
            }
            var diffuse = cosine * share;
            var gleam = shine * share;
            if is_toon {
                diffuse = toon_ramp(diffuse);
                gleam = toon_highlight(gleam);
            }
            matte += light.color * (material.y * diffuse);
            gloss += light.color * (material.z * gleam);
        }
    }
    let color = albedo * matte + gloss;
    if !is_toon || v3_dot(normal, normal) <= 0.0 {
        return color;
    }
    return limit_rgb(color) * toon_line(abs(v3_dot(normal, to_eye)));
}
