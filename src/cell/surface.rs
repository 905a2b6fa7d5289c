//! Closed-form surfaces as exact coefficient sets.

use super::{Cell, CellError, Series, default_group};
use crate::frame::Element;
use crate::symmetry::Frequency;

/// A triply periodic surface with period 1, by name.
///
/// With X = 2 pi x and so on, c = cos, s = sin, and the solid where the function is below its
/// level (0 unless another is asked for):
///
/// | name | function | solid below 0 |
/// |---|---|---|
/// | `schwarz_p` | cX + cY + cZ | network along the cube's edges |
/// | `diamond` | cX cY cZ - sX sY sZ | one of two congruent diamond networks |
/// | `iwp` | 2 (cX cY + cY cZ + cZ cX) - (c2X + c2Y + c2Z) | the wrapped side; above 0: struts of a body-centred cubic frame |
/// | `neovius` | 3 (cX + cY + cZ) + 4 cX cY cZ | network around the cube's corners |
/// | `f_rd` | 4 cX cY cZ - (c2X c2Y + c2Y c2Z + c2Z c2X) | the rhombic-dodecahedral side |
///
/// All but the diamond have the full cubic group and fit a hex; all fit a tet, where they keep the
/// cubic lattice of period 1. In a tet the network of `schwarz_p` that reaches from element to
/// element lies *above* the level: below it are balls around the vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Surface {
    /// Schwarz P.
    SchwarzP,
    /// Schwarz D in the form with tetrahedral symmetry.
    Diamond,
    /// Schoen's I-WP.
    Iwp,
    /// Neovius' C(P).
    Neovius,
    /// Schoen's F-RD.
    FRd,
}

/// Orbit representatives and coefficients. A product of cosines of n distinct axes has 2^n
/// exponentials, so that its factor is divided by 2^n.
type Terms = &'static [(Frequency<3>, [f64; 2])];

impl Surface {
    /// Every surface.
    pub const ALL: [Self; 5] = [
        Self::SchwarzP,
        Self::Diamond,
        Self::Iwp,
        Self::Neovius,
        Self::FRd,
    ];

    /// Its name in recipes.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SchwarzP => "schwarz_p",
            Self::Diamond => "diamond",
            Self::Iwp => "iwp",
            Self::Neovius => "neovius",
            Self::FRd => "f_rd",
        }
    }

    /// The surface of that name; case, `_` and `-` do not matter.
    pub fn from_name(name: &str) -> Option<Self> {
        let plain = |s: &str| s.replace(['_', '-'], "").to_ascii_lowercase();
        Self::ALL
            .into_iter()
            .find(|s| plain(s.name()) == plain(name))
    }

    /// Its function as text.
    pub const fn formula(self) -> &'static str {
        match self {
            Self::SchwarzP => "cX + cY + cZ",
            Self::Diamond => "cX cY cZ - sX sY sZ",
            Self::Iwp => "2 (cX cY + cY cZ + cZ cX) - (c2X + c2Y + c2Z)",
            Self::Neovius => "3 (cX + cY + cZ) + 4 cX cY cZ",
            Self::FRd => "4 cX cY cZ - (c2X c2Y + c2Y c2Z + c2Z c2X)",
        }
    }

    /// Coefficients under Oh; of the diamond under Td.
    const fn terms(self) -> Terms {
        match self {
            Self::SchwarzP => &[([1, 0, 0], [0.5, 0.0])],
            // sss = (i/8) sum of (product of signs) exp: the orbit of (1,1,1) under Td holds the
            // four indices whose product of signs is +1.
            Self::Diamond => &[([1, 1, 1], [0.125, -0.125])],
            Self::Iwp => &[([1, 1, 0], [0.5, 0.0]), ([2, 0, 0], [-0.5, 0.0])],
            Self::Neovius => &[([1, 0, 0], [1.5, 0.0]), ([1, 1, 1], [0.5, 0.0])],
            Self::FRd => &[([1, 1, 1], [0.5, 0.0]), ([2, 2, 0], [-0.25, 0.0])],
        }
    }

    /// The cell of an element, with level 0 and the solid below it.
    ///
    /// # Errors
    /// [`CellError::NoSuchForm`] for the diamond in a hex, and for planar elements.
    pub fn cell(self, element: Element) -> Result<Cell, CellError> {
        let no_form = |reason| CellError::NoSuchForm {
            surface: self.name(),
            element: element.name(),
            group: default_group(element),
            reason,
        };
        match element {
            Element::Tri | Element::Quad => {
                return Err(no_form("it is a surface of three dimensions"));
            }
            Element::Wedge | Element::Pyramid => {
                return Err(no_form(
                    "its periods are those of a cube; use it with hexes or tets",
                ));
            }
            Element::Hex if self == Self::Diamond => {
                return Err(no_form(
                    "half of its energy, sX sY sZ, changes sign under the inversion, and what \
                     remains is another surface; use it with tets",
                ));
            }
            Element::Tet | Element::Hex => {}
        }
        let (group, lattice) = Cell::symmetry(element, Some("cubic"))?;
        // An orbit of the full cubic group may be two opposite orbits of its subgroup; a pair is
        // listed once in either, with the same real coefficient.
        let series = Series::new(group, lattice, self.terms())?;
        Cell::new(self.name(), element, series)
    }
}
