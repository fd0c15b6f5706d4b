//! Tests that internal choices change no bit of an image: scenes with all features, divided in different ways. They are
//! apart from the library's unit tests, which would compile the rasteriser a second time.

mod background;
mod clips;
mod scenes;
mod tuning;
#[path = "../../src/simd/xorshift.rs"]
mod xorshift;
