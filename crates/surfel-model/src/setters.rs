//! Macro for the setters of `#[non_exhaustive]` structs, which other crates can't write as literals.

/// Defines a public setter for each field, inside an `impl`. Each line `with_name name: Type` gives a method
/// `with_name` that sets the field `name`. Only for this workspace's crates.
#[doc(hidden)]
#[macro_export]
macro_rules! setters {
    ($($with:ident $field:ident: $type:ty,)*) => {
        $(
            #[doc = concat!("Sets [`", stringify!($field), "`](Self::", stringify!($field), ").")]
            #[must_use]
            pub fn $with(mut self, $field: $type) -> Self {
                self.$field = $field;
                self
            }
        )*
    };
}
