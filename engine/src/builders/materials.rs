//! Default materials of builds, for parameters that leave them open.

macro_rules! defaults {
    ($($name:ident)*) => {
        $(
            /// Returns the name of this block.
            pub fn $name() -> String {
                stringify!($name).to_owned()
            }
        )*
    };
}

defaults! { stone stone_bricks oak_planks spruce_planks white_concrete gray_concrete oak_stairs oak_door }
