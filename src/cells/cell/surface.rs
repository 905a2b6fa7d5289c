//! Triply periodic surfaces in closed form, as exact coefficient sets.

use super::{Cell, CellError, Series, default_group, symmetry};
use crate::symmetry::Frequency;
use druse_geometry::frame::Element;
use std::collections::BTreeMap;

/// A triply periodic surface with period 1, by name.
///
/// With X = 2 pi x and so on, c = cos, s = sin. The solid is where the function is below its level, which
/// is 0 by default:
///
/// | name | function | solid below 0 |
/// |---|---|---|
/// | `schwarz_p` | cX + cY + cZ | network along the cube's edges |
/// | `diamond` | cX cY cZ - sX sY sZ | one of two congruent diamond networks |
/// | `iwp` | 2 (cX cY + cY cZ + cZ cX) - (c2X + c2Y + c2Z) | the wrapped side; above 0: struts of a body-centred cubic frame |
/// | `neovius` | 3 (cX + cY + cZ) + 4 cX cY cZ | network around the cube's corners |
/// | `f_rd` | 4 cX cY cZ - (c2X c2Y + c2Y c2Z + c2Z c2X) | the rhombic-dodecahedral side |
/// | `gyroid` | sX cY + sY cZ + sZ cX | one of two mirror-image networks |
/// | `lidinoid` | (s2X cY sZ + s2Y cZ sX + s2Z cX sY - c2X c2Y - c2Y c2Z - c2Z c2X) / 2 + 0.15 | one of two sides |
///
/// Gyroid and lidinoid have no point of cubic symmetry: the average of the gyroid over any cubic group
/// about the usual origin is zero. They are periodic cells of the hex without symmetries (group C1),
/// which fill only scaffolds whose elements all have the same orientation, such as a box.
///
/// All others except the diamond have the full cubic group and fit a hex. These and the diamond also fit
/// a tet, where they keep the cubic lattice of period 1. In a hex the diamond has the group Td, a subgroup
/// of the hex's own, and fills scaffolds whose elements have the same orientation. In a tet, the network
/// of `schwarz_p` that connects neighbouring elements lies *above* the level; below it are balls around
/// the vertices.
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
    /// Schoen's gyroid.
    Gyroid,
    /// Lidin's surface.
    Lidinoid,
}

/// Orbit representatives and coefficients. A product of cosines along n distinct axes has 2^n
/// exponentials, so that its factor is divided by 2^n.
#[doc(hidden)]
pub type Terms = &'static [(Frequency<3>, [f64; 2])];

/// A product over the axes: a factor, and for each axis the sine or cosine of a multiple of 2 pi x.
type Product = (f64, [(TrigFunction, i32); 3]);

#[derive(Clone, Copy, PartialEq)]
enum TrigFunction {
    Sin,
    Cos,
}
use TrigFunction::{Cos, Sin};

const GYROID: &[Product] = &[
    (1.0, [(Sin, 1), (Cos, 1), (Cos, 0)]),
    (1.0, [(Cos, 0), (Sin, 1), (Cos, 1)]),
    (1.0, [(Cos, 1), (Cos, 0), (Sin, 1)]),
];
const LIDINOID: &[Product] = &[
    (0.5, [(Sin, 2), (Cos, 1), (Sin, 1)]),
    (0.5, [(Sin, 1), (Sin, 2), (Cos, 1)]),
    (0.5, [(Cos, 1), (Sin, 1), (Sin, 2)]),
    (-0.5, [(Cos, 2), (Cos, 2), (Cos, 0)]),
    (-0.5, [(Cos, 0), (Cos, 2), (Cos, 2)]),
    (-0.5, [(Cos, 2), (Cos, 0), (Cos, 2)]),
    (0.15, [(Cos, 0), (Cos, 0), (Cos, 0)]),
];

/// Expands the products into exponentials; keeps one of each pair +-k.
fn exponentials(products: &[Product]) -> Vec<(Frequency<3>, [f64; 2])> {
    let mut terms = BTreeMap::<Frequency<3>, [f64; 2]>::new();
    for (factor, axes) in products {
        for signs in 0..8 {
            // cos = (e+ + e-) / 2, sin = -i (e+ - e-) / 2: each sine multiplies by -+ i.
            let mut c = [factor / 8.0, 0.0];
            let mut k = [0; 3];
            for (a, (wave, multiple)) in axes.iter().enumerate() {
                let sign = if signs >> a & 1 == 1 { -1 } else { 1 };
                k[a] = sign * multiple;
                if *wave == Sin {
                    let s = f64::from(sign);
                    c = [s * c[1], -s * c[0]];
                }
            }
            let sum = terms.entry(k).or_default();
            *sum = [sum[0] + c[0], sum[1] + c[1]];
        }
    }
    let first = |k: &Frequency<3>| *k >= k.map(|c| -c);
    terms.into_iter().filter(|t| first(&t.0)).collect()
}

impl Surface {
    /// Every surface.
    pub const CATALOGUE: [Self; 7] = [
        Self::SchwarzP,
        Self::Diamond,
        Self::Iwp,
        Self::Neovius,
        Self::FRd,
        Self::Gyroid,
        Self::Lidinoid,
    ];

    /// The name in recipes.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SchwarzP => "schwarz_p",
            Self::Diamond => "diamond",
            Self::Iwp => "iwp",
            Self::Neovius => "neovius",
            Self::FRd => "f_rd",
            Self::Gyroid => "gyroid",
            Self::Lidinoid => "lidinoid",
        }
    }

    /// The surface with the given name; case, `_` and `-` are ignored.
    pub fn from_name(name: &str) -> Option<Self> {
        let normalized = |s: &str| s.replace(['_', '-'], "").to_ascii_lowercase();
        Self::CATALOGUE
            .into_iter()
            .find(|s| normalized(s.name()) == normalized(name))
    }

    /// The default element: the tet for the diamond, whose group is that of a tet; else the hex.
    pub const fn element(self) -> Element {
        match self {
            Self::Diamond => Element::Tet,
            _ => Element::Hex,
        }
    }

    /// The function as text.
    pub const fn formula(self) -> &'static str {
        match self {
            Self::SchwarzP => "cX + cY + cZ",
            Self::Diamond => "cX cY cZ - sX sY sZ",
            Self::Iwp => "2 (cX cY + cY cZ + cZ cX) - (c2X + c2Y + c2Z)",
            Self::Neovius => "3 (cX + cY + cZ) + 4 cX cY cZ",
            Self::FRd => "4 cX cY cZ - (c2X c2Y + c2Y c2Z + c2Z c2X)",
            Self::Gyroid => "sX cY + sY cZ + sZ cX",
            Self::Lidinoid => {
                "(s2X cY sZ + s2Y cZ sX + s2Z cX sY - c2X c2Y - c2Y c2Z - c2Z c2X) / 2 + 0.15"
            }
        }
    }

    /// Coefficients under Oh, for the diamond under Td; empty for gyroid and lidinoid.
    const fn terms(self) -> Terms {
        match self {
            Self::Gyroid | Self::Lidinoid => &[],
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
    /// [`CellError::NoSuchForm`] for gyroid and lidinoid in a tet, and for other elements.
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
            Element::Wedge | Element::Pyramid | Element::Ball => {
                return Err(no_form(
                    "its periods are those of a cube; use it with hexes or tets",
                ));
            }
            Element::Tet if matches!(self, Self::Gyroid | Self::Lidinoid) => {
                return Err(no_form(
                    "it has no point with the symmetry of a tet, and its average over the group's \
                     images about the usual origin is zero; use it with a box of hexes",
                ));
            }
            Element::Tet | Element::Hex => {}
        }
        if let Self::Gyroid | Self::Lidinoid = self {
            let products = if self == Self::Gyroid {
                GYROID
            } else {
                LIDINOID
            };
            let (group, lattice) = symmetry(element, Some("C1"), Some("cubic"))?;
            let series = Series::new(group, lattice, &exponentials(products))?;
            return Cell::new(self.name(), element, series);
        }
        // Under inversion the term sX sY sZ of the diamond changes sign.
        let group = (self == Self::Diamond).then_some("Td");
        of_terms(self.name(), (element, group), self.terms())
    }
}

/// A cell on the cubic lattice from one coefficient of each orbit, under a group or that of the element.
///
/// # Errors
/// [`CellError`] for an unknown group.
#[doc(hidden)]
pub fn of_terms(
    name: &str,
    (element, group): (Element, Option<&str>),
    terms: Terms,
) -> Result<Cell, CellError> {
    let (group, lattice) = symmetry(element, group, Some("cubic"))?;
    // An orbit of the full cubic group may split into two opposite orbits of its subgroup. The pair is then listed
    // once, with the same real coefficient.
    let series = Series::new(group, lattice, terms)?;
    Cell::new(name, element, series)
}
