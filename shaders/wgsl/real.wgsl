// Sums and differences of two products in nearly exact arithmetic. Twin: surfel-math, real.rs.
//
// Source: Dekker 1971, which splits a product into a rounded head and an exact rest. The twin's fma (Kahan) isn't used.
// WGSL lets an implementation round an fma twice, and lets it fuse a product and a sum that are written separately.
//
// Here every product whose rounding matters has factors of 12 bits, so it is exact however it is evaluated. Heads pass
// through integer arithmetic, across which nothing is fused. The error is below 2 ulp of the result, however much
// cancels.

// Returns a rounded to the upper 12 bits of its significand. The difference from a is exact and has 12 bits, too.
fn upper_half(a: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(a) & 0xfffff000u);
}

// Returns a·b, rounded. The comparison prevents compilers from fusing the product into a sum. No product is as large as
// the bound, but compilers can't know that.
fn product_head(a: f32, b: f32) -> f32 {
    let product = a * b;
    return bitcast<f32>(bitcast<u32>(product) ^ select(0u, 1u, abs(product) > 3.4e38));
}

// Returns a·b − head, exactly. `head` is the rounded product that `product_head` returns for a and b.
fn product_rest(a: f32, b: f32, head: f32) -> f32 {
    let a_upper = upper_half(a);
    let b_upper = upper_half(b);
    let a_lower = a - a_upper;
    let b_lower = b - b_upper;
    return (((a_upper * b_upper - head) + a_upper * b_lower) + a_lower * b_upper) + a_lower * b_lower;
}

// Returns a·b − c·d.
fn difference_of_products(a: f32, b: f32, c: f32, d: f32) -> f32 {
    let ab = product_head(a, b);
    let cd = product_head(c, d);
    return (ab - cd) + (product_rest(a, b, ab) - product_rest(c, d, cd));
}

// Returns a·b + c·d.
fn sum_of_products(a: f32, b: f32, c: f32, d: f32) -> f32 {
    return difference_of_products(a, b, -c, d);
}
