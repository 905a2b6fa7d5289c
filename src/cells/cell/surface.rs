//! Triply periodic surfaces in closed form, as exact coefficient sets.
//!
//! Each surface is a sum of few products of sines and cosines of multiples of 2 pi times a coordinate, and its period
//! is 1 along each axis. Those with a point group are listed by one coefficient per orbit, the others by products that
//! are expanded into exponentials. The coefficients are exact; no fit is involved.

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
/// | `double_gyroid` | 2.75 (s2X cY sZ + s2Y cZ sX + s2Z cX sY) - (c2X c2Y + c2Y c2Z + c2Z c2X) | both networks of the gyroid |
/// | `fischer_koch_s` | c2X sY cZ + c2Y sZ cX + c2Z sX cY | one of two congruent networks |
/// | `c_y` | s2X sY + s2Y sZ + s2Z sX - sX sY sZ - cX cY cZ + s2X cZ + s2Y cX + s2Z cY | one of two sides |
/// | `c_s` | c2X + c2Y + c2Z + 2 (s3X s2Y cZ + s3Y s2Z cX + s3Z s2X cY) + 2 (s2X c3Y sZ + s2Y c3Z sX + s2Z c3X sY) | one of two sides |
/// | `split_p` | 1.1 (s2X cY sZ + s2Y cZ sX + s2Z cX sY) - 0.2 (c2X c2Y + c2Y c2Z + c2Z c2X) - 0.4 (c2X + c2Y + c2Z) | one of two sides |
/// | `lidinoid` | (s2X cY sZ + s2Y cZ sX + s2Z cX sY - c2X c2Y - c2Y c2Z - c2Z c2X) / 2 + 0.15 | one of two sides |
///
/// Those with sines but the diamond have no point of cubic symmetry: the average of the gyroid over any cubic group
/// about the usual origin is zero. Their groups have fractions of the period (`I4132` for the gyroid). They are periodic
/// cells of the hex without a point group (C1), which fill scaffolds whose elements can all be turned alike, such as a box.
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
    /// Both networks of the gyroid.
    DoubleGyroid,
    /// S of Fischer and Koch.
    FischerKochS,
    /// C(Y) of Fischer and Koch.
    CY,
    /// C(S) of Fischer and Koch.
    CS,
    /// Split P.
    SplitP,
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
const FISCHER_KOCH_S: &[Product] = &[
    (1.0, [(Cos, 2), (Sin, 1), (Cos, 1)]),
    (1.0, [(Cos, 1), (Cos, 2), (Sin, 1)]),
    (1.0, [(Sin, 1), (Cos, 1), (Cos, 2)]),
];
const C_Y: &[Product] = &[
    (1.0, [(Sin, 2), (Sin, 1), (Cos, 0)]),
    (1.0, [(Cos, 0), (Sin, 2), (Sin, 1)]),
    (1.0, [(Sin, 1), (Cos, 0), (Sin, 2)]),
    (-1.0, [(Sin, 1), (Sin, 1), (Sin, 1)]),
    (-1.0, [(Cos, 1), (Cos, 1), (Cos, 1)]),
    (1.0, [(Sin, 2), (Cos, 0), (Cos, 1)]),
    (1.0, [(Cos, 1), (Sin, 2), (Cos, 0)]),
    (1.0, [(Cos, 0), (Cos, 1), (Sin, 2)]),
];
const C_S: &[Product] = &[
    (1.0, [(Cos, 2), (Cos, 0), (Cos, 0)]),
    (1.0, [(Cos, 0), (Cos, 2), (Cos, 0)]),
    (1.0, [(Cos, 0), (Cos, 0), (Cos, 2)]),
    (2.0, [(Sin, 3), (Sin, 2), (Cos, 1)]),
    (2.0, [(Cos, 1), (Sin, 3), (Sin, 2)]),
    (2.0, [(Sin, 2), (Cos, 1), (Sin, 3)]),
    (2.0, [(Sin, 2), (Cos, 3), (Sin, 1)]),
    (2.0, [(Sin, 1), (Sin, 2), (Cos, 3)]),
    (2.0, [(Cos, 3), (Sin, 1), (Sin, 2)]),
];
const DOUBLE_GYROID: &[Product] = &[
    (2.75, [(Sin, 2), (Cos, 1), (Sin, 1)]),
    (2.75, [(Sin, 1), (Sin, 2), (Cos, 1)]),
    (2.75, [(Cos, 1), (Sin, 1), (Sin, 2)]),
    (-1.0, [(Cos, 2), (Cos, 2), (Cos, 0)]),
    (-1.0, [(Cos, 0), (Cos, 2), (Cos, 2)]),
    (-1.0, [(Cos, 2), (Cos, 0), (Cos, 2)]),
];
const SPLIT_P: &[Product] = &[
    (1.1, [(Sin, 2), (Cos, 1), (Sin, 1)]),
    (1.1, [(Sin, 1), (Sin, 2), (Cos, 1)]),
    (1.1, [(Cos, 1), (Sin, 1), (Sin, 2)]),
    (-0.2, [(Cos, 2), (Cos, 2), (Cos, 0)]),
    (-0.2, [(Cos, 0), (Cos, 2), (Cos, 2)]),
    (-0.2, [(Cos, 2), (Cos, 0), (Cos, 2)]),
    (-0.4, [(Cos, 2), (Cos, 0), (Cos, 0)]),
    (-0.4, [(Cos, 0), (Cos, 2), (Cos, 0)]),
    (-0.4, [(Cos, 0), (Cos, 0), (Cos, 2)]),
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
/// The pairs are of an index along x, y and z and (re, im); the coefficient of -k is the conjugate.
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
    pub const CATALOGUE: [Self; 12] = [
        Self::SchwarzP,
        Self::Diamond,
        Self::Iwp,
        Self::Neovius,
        Self::FRd,
        Self::Gyroid,
        Self::Lidinoid,
        Self::DoubleGyroid,
        Self::FischerKochS,
        Self::CY,
        Self::CS,
        Self::SplitP,
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
            Self::DoubleGyroid => "double_gyroid",
            Self::FischerKochS => "fischer_koch_s",
            Self::CY => "c_y",
            Self::CS => "c_s",
            Self::SplitP => "split_p",
        }
    }

    /// The surface with the given name; case, `_` and `-` are ignored.
    /// `None` for an unknown name.
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
    /// The notation is that of [`Surface`]'s table.
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
            Self::DoubleGyroid => {
                "2.75 (s2X cY sZ + s2Y cZ sX + s2Z cX sY) - (c2X c2Y + c2Y c2Z + c2Z c2X)"
            }
            Self::FischerKochS => "c2X sY cZ + c2Y sZ cX + c2Z sX cY",
            Self::CY => "s2X sY + s2Y sZ + s2Z sX - sX sY sZ - cX cY cZ + s2X cZ + s2Y cX + s2Z cY",
            Self::CS => {
                "c2X + c2Y + c2Z + 2 (s3X s2Y cZ + s3Y s2Z cX + s3Z s2X cY) + 2 (s2X c3Y sZ + s2Y c3Z sX + s2Z c3X sY)"
            }
            Self::SplitP => {
                "1.1 (s2X cY sZ + s2Y cZ sX + s2Z cX sY) - 0.2 (c2X c2Y + c2Y c2Z + c2Z c2X) - 0.4 (c2X + c2Y + c2Z)"
            }
        }
    }

    /// The products of those that have no point group; empty for the others.
    const fn products(self) -> &'static [Product] {
        match self {
            Self::Gyroid => GYROID,
            Self::Lidinoid => LIDINOID,
            Self::DoubleGyroid => DOUBLE_GYROID,
            Self::FischerKochS => FISCHER_KOCH_S,
            Self::CY => C_Y,
            Self::CS => C_S,
            Self::SplitP => SPLIT_P,
            _ => &[],
        }
    }

    /// Coefficients under Oh, for the diamond under Td; empty for those without a point group.
    const fn terms(self) -> Terms {
        match self {
            Self::SchwarzP => &[([1, 0, 0], [0.5, 0.0])],
            // sss = (i/8) sum of (product of signs) exp: the orbit of (1,1,1) under Td holds the
            // four indices whose product of signs is +1.
            Self::Diamond => &[([1, 1, 1], [0.125, -0.125])],
            Self::Iwp => &[([1, 1, 0], [0.5, 0.0]), ([2, 0, 0], [-0.5, 0.0])],
            Self::Neovius => &[([1, 0, 0], [1.5, 0.0]), ([1, 1, 1], [0.5, 0.0])],
            Self::FRd => &[([1, 1, 1], [0.5, 0.0]), ([2, 2, 0], [-0.25, 0.0])],
            _ => &[],
        }
    }

    /// The cell of an element, with level 0 and the solid below it.
    /// The default name of the cell is the surface's. In a tet the periods are still those of the cube.
    ///
    /// # Errors
    /// [`CellError::NoSuchForm`] for surfaces without a point group in a tet, and for other elements.
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
            Element::Tet if !self.products().is_empty() => {
                return Err(no_form(
                    "it has no point with the symmetry of a tet; use it with a box of hexes",
                ));
            }
            Element::Tet | Element::Hex => {}
        }
        let products = self.products();
        if !products.is_empty() {
            let (group, lattice) = symmetry(element, Some("C1"), Some("cubic"))?;
            let series = Series::new(group, lattice, &exponentials(products))?;
            return Cell::new(self.name(), element, series);
        }
        // Under inversion the term sX sY sZ of the diamond changes sign.
        let group = (self == Self::Diamond).then_some("Td");
        of_terms(self.name(), element, group, self.terms())
    }
}

/// A cell on the cubic lattice from one coefficient of each orbit, under the group of a name, or with `None` under that
/// of the element.
/// `terms` are an index and (re, im). The level is 0 and the solid below it.
///
/// # Errors
/// [`CellError`] for a group that is unknown or unfit for the element, or terms that are no function of the group.
#[doc(hidden)]
pub fn of_terms(
    name: &str,
    element: Element,
    group: Option<&str>,
    terms: Terms,
) -> Result<Cell, CellError> {
    let (group, lattice) = symmetry(element, group, Some("cubic"))?;
    // An orbit of the full cubic group may split into two opposite orbits of its subgroup. The pair is then listed
    // once, with the same real coefficient.
    let series = Series::new(group, lattice, terms)?;
    Cell::new(name, element, series)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{FitOptions, Method, fit};
    use crate::symmetry::SpaceGroup;
    use druse_geometry::field::Field;
    use druse_geometry::frame::CellPoint;
    use druse_geometry::progress::Silent;

    /// The group of each function is the largest of the tables, in their settings, that leaves it unchanged.
    #[test]
    fn surfaces_have_their_space_groups() {
        let groups = [
            (Surface::SchwarzP, "Pm-3m"),
            (Surface::Diamond, "F-43m"),
            (Surface::Iwp, "Im-3m"),
            (Surface::Neovius, "Pm-3m"),
            (Surface::FRd, "Fm-3m"),
            (Surface::Gyroid, "I4132"),
            (Surface::Lidinoid, "Ia-3d"),
            (Surface::DoubleGyroid, "Ia-3d"),
            (Surface::FischerKochS, "I-43d"),
            (Surface::CY, "P4332"),
            (Surface::CS, "Ia-3"),
            (Surface::SplitP, "Ia-3"),
        ];
        assert_eq!(groups.map(|g| g.0), Surface::CATALOGUE);
        let points = [[0.11, -0.23, 0.37], [0.41, 0.07, -0.19]];
        // The settings of the cubic groups and of the others that a cube has.
        let order = |cell: &Cell, group: &SpaceGroup<3>| {
            let is_kept = points.iter().all(|&p| {
                let value = Field::value(cell, CellPoint(p.into()));
                let image = |p: [f64; 3]| Field::value(cell, CellPoint(p.into()));
                let all = group.operators().iter();
                all.clone()
                    .all(|g| (image(g.apply(p)) - value).abs() < 1e-9)
            });
            if is_kept { group.operators().len() } else { 0 }
        };
        let cubic = (489..=530).filter_map(moyo::data::hall_symbol_entry);
        let cubic: Vec<SpaceGroup<3>> = cubic
            .filter_map(|e| SpaceGroup::named(&format!("{}:{}", e.hm_short, e.setting)))
            .collect();
        assert_eq!(cubic.len(), 42);
        for (surface, name) in groups {
            let cell = surface.cell(Element::Hex).unwrap();
            let own = order(&cell, &SpaceGroup::named(name).unwrap());
            let most = cubic.iter().map(|g| order(&cell, g)).max().unwrap();
            assert!(own > 0 && own == most, "{surface:?}: {own} {most}");
        }
    }

    /// A gyroid with a wave that its group does not have: the fit under the group is the gyroid.
    #[test]
    fn a_fit_under_a_space_group_keeps_its_part_alone() {
        let gyroid = Surface::Gyroid.cell(Element::Hex).unwrap();
        let source = |p: CellPoint<3>| {
            let [x, y, z] = [p.0.x, p.0.y, p.0.z].map(|c| std::f64::consts::TAU * c);
            let gyroid = x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos();
            gyroid + 0.2 * (x + z).cos()
        };
        let options = FitOptions {
            band_limit: 1.5,
            method: Method::Fft,
            measure: false,
            group: Some("I4132".to_owned()),
            ..FitOptions::default()
        };
        let cell = fit("g", Element::Hex, &source, &options, &Silent).unwrap();
        for p in [[0.1, 0.2, -0.4], [0.0, 0.3, 0.45]] {
            let p = CellPoint(p.into());
            let [a, b] = [&cell, &gyroid].map(|c| Field::value(c, p));
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
        // The file keeps the operators without fractions by their generators.
        let back = Cell::from_json(&cell.to_json()).unwrap();
        assert_eq!(back.operators().len(), 3);
        let text = "z,x,y; x+1/2,-y+1/2,-z; 3/4+y,1/4+x,1/4-z; x+1/2,y+1/2,z+1/2";
        let same = SpaceGroup::<3>::generated(text).unwrap();
        let named = SpaceGroup::<3>::named("I 4_1 3 2").unwrap();
        assert_eq!(same.operators(), named.operators());
        let error = |element, group: &str| {
            let options = FitOptions {
                group: Some(group.to_owned()),
                ..FitOptions::default()
            };
            let found = fit("g", element, &source, &options, &Silent);
            found.err().unwrap().to_string()
        };
        assert!(error(Element::Hex, "P6322").contains("P6322"));
        assert!(error(Element::Tet, "I4132").contains("for hexes"));
        assert!(error(Element::Hex, "I4133").contains("I4133"));
        assert!(error(Element::Hex, "x+1/7,y,z").contains("1/7"));
    }
}
