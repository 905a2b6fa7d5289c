//! A series by symmetrised products: cosines and sines along each axis, then sums over their products. What
//! a program does that evaluates the series itself at every voxel, done well: many points at a time.

use druse::cell::Cell;
use druse::frame::CellPoint;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Points together.
const BATCH_LEAVES: usize = 32;
type Row = [f32; BATCH_LEAVES];
/// Most that the sums may be off, in the cell's units.
const ERROR: f64 = 1e-3;

/// Terms with the same functions of x and y.
struct Group {
    x: usize,
    y: usize,
    /// Index along z, and the factors of the product of cosines and of that of sines.
    terms: Vec<(usize, f32, f32)>,
}

/// Sums of products of cosines and of sines, with the period 2 along each axis.
pub struct Products {
    groups: Vec<Group>,
    greatest: usize,
    level: f32,
}

impl Products {
    /// Of a cell of a tet that is a single series; all that is odd in one or two coordinates cancels.
    pub fn of(cell: &Cell) -> Result<Self, Box<dyn std::error::Error>> {
        let series = cell.series().ok_or("a cell that is no series")?;
        let mut groups: BTreeMap<[usize; 2], BTreeMap<usize, [f64; 2]>> = BTreeMap::new();
        let mut greatest = 0;
        for &(k, [re, im]) in series.exponentials() {
            let h = (series.lattice().frequency(k) * 2.0).map(|f| f.round() as i32);
            let [x, y, z] = [h.x, h.y, h.z].map(|h| h.unsigned_abs() as usize);
            greatest = greatest.max(x).max(y).max(z);
            let term = groups.entry([x, y]).or_default().entry(z).or_default();
            term[0] += re;
            term[1] += im * f64::from(h.x.signum() * h.y.signum() * h.z.signum());
        }
        let group = |([x, y], terms): ([usize; 2], BTreeMap<usize, [f64; 2]>)| Group {
            x,
            y,
            terms: terms
                .into_iter()
                .map(|(z, [c, s])| (z, c as f32, s as f32))
                .collect(),
        };
        let made = Self {
            groups: groups.into_iter().map(group).collect(),
            greatest,
            level: cell.level() as f32,
        };
        let points = std::array::from_fn(|n| {
            CellPoint([0.13, 0.31, 0.07].map(|c| c * n as f64 / 7.0).into())
        });
        let mut values = [0.0; BATCH_LEAVES];
        made.values(&points, &mut values);
        for (p, v) in points.iter().zip(values) {
            let exact = druse::field::Field::value(cell, *p);
            if (exact - f64::from(v)).abs() > ERROR {
                return Err(format!("products give {v} at {p:?}, the series {exact}").into());
            }
        }
        Ok(made)
    }

    /// How many products there are.
    pub fn terms(&self) -> usize {
        self.groups.iter().map(|g| g.terms.len()).sum()
    }

    /// Values at points, as the processor can.
    pub fn values(&self, points: &[CellPoint<3>; BATCH_LEAVES], out: &mut Row) {
        pulp::Arch::new().dispatch(Sum {
            products: self,
            points,
            out,
        });
    }

    /// All of some points.
    pub fn all(&self, points: &[CellPoint<3>]) {
        let mut out = [0.0; BATCH_LEAVES];
        for points in points.as_chunks().0 {
            self.values(points, &mut out);
            std::hint::black_box(&out);
        }
    }
}

struct Sum<'a> {
    products: &'a Products,
    points: &'a [CellPoint<3>; BATCH_LEAVES],
    out: &'a mut Row,
}

#[allow(clippy::inline_always)]
impl pulp::NullaryFnOnce for Sum<'_> {
    type Output = ();

    // No closures: they would be compiled for any processor.
    #[inline(always)]
    fn call(self) {
        let mut along = [const { Vec::new() }; 3];
        for (axis, along) in along.iter_mut().enumerate() {
            let (mut c, mut s) = ([0f32; BATCH_LEAVES], [0f32; BATCH_LEAVES]);
            for n in 0..BATCH_LEAVES {
                let turn = TAU / 2.0 * self.points[n].0[axis];
                (s[n], c[n]) = ((turn.sin()) as f32, (turn.cos()) as f32);
            }
            let (mut cosine, mut sine) = ([1f32; BATCH_LEAVES], [0f32; BATCH_LEAVES]);
            for _ in 0..=self.products.greatest {
                along.push([cosine, sine]);
                for n in 0..BATCH_LEAVES {
                    let next = cosine[n] * c[n] - sine[n] * s[n];
                    sine[n] = sine[n] * c[n] + cosine[n] * s[n];
                    cosine[n] = next;
                }
            }
        }
        let [x, y, z] = &along;
        let mut sum = [-self.products.level; BATCH_LEAVES];
        for group in &self.products.groups {
            let (mut even, mut odd) = ([0f32; BATCH_LEAVES], [0f32; BATCH_LEAVES]);
            for &(k, a, b) in &group.terms {
                let [c, s] = &z[k];
                for n in 0..BATCH_LEAVES {
                    even[n] = c[n].mul_add(a, even[n]);
                    odd[n] = s[n].mul_add(b, odd[n]);
                }
            }
            let ([cx, sx], [cy, sy]) = (&x[group.x], &y[group.y]);
            for n in 0..BATCH_LEAVES {
                sum[n] += cx[n] * cy[n] * even[n] + sx[n] * sy[n] * odd[n];
            }
        }
        *self.out = sum;
    }
}
