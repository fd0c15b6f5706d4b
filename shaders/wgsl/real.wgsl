// Exact differences of products. Twin: surfel-math, real.rs.
//
// Source: Kahan; bound by Jeannerod, Louvet and Muller 2013. The bound holds where fma rounds once. WGSL lets an
// implementation round twice, which costs the last bits of what cancels and nothing else.

// a·b − c·d.
fn difference_of_products(a: f32, b: f32, c: f32, d: f32) -> f32 {
    let cd = c * d;
    let rounding = fma(-c, d, cd);
    return fma(a, b, -cd) + rounding;
}

// a·b + c·d.
fn sum_of_products(a: f32, b: f32, c: f32, d: f32) -> f32 {
    return difference_of_products(a, b, -c, d);
}
