//! What builds are made of where their parameters do not say.

macro_rules! defaults {
    ($($name:ident)*) => {
        $(
            /// The block of this name.
            pub fn $name() -> String {
                stringify!($name).to_owned()
            }
        )*
    };
}

defaults! { stone stone_bricks oak_planks spruce_planks white_concrete gray_concrete oak_stairs oak_door }
