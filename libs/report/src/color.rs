//! Colours of figures and snapshots.

/// Colour: red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Color(pub u8, pub u8, pub u8);

/// Okabe and Ito's palette, which colour-blind readers can distinguish, and greys.
impl Color {
    /// Almost black.
    pub const INK: Self = Self(34, 34, 34);
    /// Grey, for the background.
    pub const GREY: Self = Self(130, 130, 130);
    /// Light grey, for grids.
    pub const LIGHT: Self = Self(225, 225, 225);
    /// Blue.
    pub const BLUE: Self = Self(0, 114, 178);
    /// Vermillion.
    pub const VERMILLION: Self = Self(213, 94, 0);
    /// Bluish green.
    pub const GREEN: Self = Self(0, 158, 115);
    /// Orange.
    pub const ORANGE: Self = Self(230, 159, 0);
    /// Light orange, for a curve behind another.
    pub const SAND: Self = Self(250, 205, 120);
    /// Sky blue.
    pub const SKY: Self = Self(86, 180, 233);
    /// Reddish purple.
    pub const PURPLE: Self = Self(204, 121, 167);

    /// Colour of the item `index` in a list without own colours.
    #[must_use]
    pub const fn cycle(index: usize) -> Self {
        const CYCLE: [Color; 7] =
            [Color::BLUE, Color::ORANGE, Color::GREEN, Color::VERMILLION, Color::PURPLE, Color::SKY, Color::GREY];
        CYCLE[index % CYCLE.len()]
    }
}
