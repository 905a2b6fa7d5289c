//! Positions of the vertices of a tier of an extrusion: one rule per kind of tier, for any polygon.
//!
//! Tier k has the length `t_k` L, with L the mean edge length of the base. With the factors sqrt(3)/2,
//! cos 54 degrees and sqrt 2, t = 1 gives new edges of length L where the base is a face of the regular solid.
//! For tiers over the middles of edges t is therefore a ratio of slant heights.

use super::polygon::{EdgePlane, Polygon, intersection_direction, mean, unit};
use druse_geometry::frame::Vec3;

/// The rule that places the vertices of a tier. `b_i` is corner i of the base, L its mean edge length, t the
/// ratio of the tier, `u_i` the slope direction of edge i, `d_i` the ridge direction of corner i.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TierRule {
    /// One point: the mean of (midpoint of edge i) + sqrt(3)/2 t L `u_i` over the edges.
    Apex,
    /// `b_i` + t L `d_i`.
    Ridge,
    /// Midpoint of edge i + sqrt(3)/2 t L `u_i`.
    Slope,
    /// Midpoint of vertices i and i+1 of the first tier + cos(54 degrees) t L `u_i`.
    Roof,
    /// From roof vertex i along the intersection line of the planes of the two pentagons that meet there.
    Crest,
    /// From corner i along the intersection line of the planes through its edges to the two adjacent
    /// slope vertices.
    LowEdgePlane,
    /// From slope vertex i along the intersection line of the planes through its edges to the two
    /// vertices of the tier `LowEdgePlane` above corners i and i+1.
    HighEdgePlane,
    /// `b_i` + sqrt 2 t L towards the midpoint of the two adjacent slope vertices.
    Flank,
    /// Two points per corner: `b_i` + t L up the side planes of the edges before and after it.
    Fold,
    /// Two points per corner: from those of `Fold`, along directions folded inward by delta.
    Refold,
    /// One point per corner: the mean of the two `Refold` points, raised along the mean of the next fold directions.
    Close,
}

/// The vertices of all tiers over one polygon.
pub(super) struct TierPoints {
    /// The vertices, tier by tier.
    pub points: Vec<Vec3>,
    /// The unit direction along which each vertex of the last tier was placed.
    pub directions: Vec<Vec3>,
}

/// Places the vertices of all tiers over a polygon. `delta` is the dihedral angle in radians, `tiers` holds one ratio
/// of the mean edge length per rule.
///
/// # Errors
/// The reason, where a direction is undefined.
pub(super) fn place_tiers(
    base: &Polygon,
    rules: &[TierRule],
    delta: f64,
    tiers: &[f64],
) -> Result<TierPoints, String> {
    let mut builder = TierBuilder {
        base,
        delta,
        tiers: Vec::new(),
        directions: Vec::new(),
    };
    for (&rule, &t) in rules.iter().zip(tiers) {
        let tier = builder.tier(rule, t * base.mean_edge)?;
        builder.tiers.push(tier);
    }
    Ok(TierPoints {
        points: builder.tiers.concat(),
        directions: builder.directions,
    })
}

struct TierBuilder<'a> {
    base: &'a Polygon,
    delta: f64,
    /// The tiers placed so far.
    tiers: Vec<Vec<Vec3>>,
    directions: Vec<Vec3>,
}

impl TierBuilder<'_> {
    /// The vertices of tier `k`, from 0 for the lowest.
    fn placed_tier(&self, k: usize) -> &[Vec3] {
        &self.tiers[k]
    }

    /// Places one tier of the length `length` (the ratio times the mean edge), and keeps its directions. Rules refer to
    /// the tiers below, which the table of kinds lists before them. The error is a reason.
    fn tier(&mut self, rule: TierRule, length: f64) -> Result<Vec<Vec3>, String> {
        let (base, delta) = (self.base, self.delta);
        let n = base.len();
        let slope_factor = 3f64.sqrt() / 2.0;
        let before = |i: usize| (i + n - 1) % n;
        let after = |i: usize| (i + 1) % n;
        // Each rule but `Apex` and `Close` gives a start and a unit direction per vertex; the vertex is start +
        // factor length direction, as [`TierRule`] lists.
        let starts: Vec<Vec3>;
        let mut factor = 1.0;
        let directions: Vec<Vec3> = match rule {
            TierRule::Apex => {
                let tips: Vec<Vec3> = (0..n)
                    .map(|i| base.middle(i) + slope_factor * length * base.slope(i, delta))
                    .collect();
                self.directions = vec![base.normal];
                return Ok(vec![mean(&tips)]);
            }
            TierRule::Ridge => {
                starts = base.points.clone();
                (0..n)
                    .map(|i| base.ridge(i, delta))
                    .collect::<Result<_, _>>()?
            }
            TierRule::Slope => {
                factor = slope_factor;
                starts = (0..n).map(|i| base.middle(i)).collect();
                (0..n).map(|i| base.slope(i, delta)).collect()
            }
            TierRule::Roof => {
                factor = 54f64.to_radians().cos();
                let low = self.placed_tier(0);
                starts = (0..n).map(|i| (low[i] + low[after(i)]) / 2.0).collect();
                (0..n).map(|i| base.slope(i, delta)).collect()
            }
            // The pentagon above corner i has the plane through ridge vertex i and the roof vertices on both sides.
            TierRule::Crest => {
                let (low, high) = (self.placed_tier(0), self.placed_tier(1));
                starts = high.to_vec();
                let plane = |i: usize| {
                    let (r, l) = (high[i] - low[i], high[before(i)] - low[i]);
                    // Parallel edges span no plane; with a zero normal `intersection_direction` takes the bisector.
                    let cross = r.cross(&l);
                    let is_degenerate = cross.norm() < 1e-9 * r.norm() * l.norm();
                    let normal = unit(cross).filter(|_| !is_degenerate);
                    EdgePlane {
                        normal: normal.unwrap_or_else(Vec3::zeros),
                        away: (r + l) / 2.0,
                    }
                };
                (0..n)
                    .map(|i| defined(intersection_direction(plane(i), plane(after(i))), i))
                    .collect::<Result<_, _>>()?
            }
            // The planes through the edges from b_i to the slope vertices, each at the dihedral angle to the first
            // tier's face, whose normal into the new solid is minus the outward; edges run counter-clockwise about it.
            TierRule::LowEdgePlane => {
                let low = self.placed_tier(0);
                starts = base.points.clone();
                let outward = self.outward_normals(low)?;
                (0..n)
                    .map(|i| {
                        let b = base.points[i];
                        let p = EdgePlane::new(b - low[before(i)], -outward[before(i)], delta);
                        let q = EdgePlane::new(low[i] - b, -outward[i], delta);
                        defined(p.zip(q).and_then(|(p, q)| intersection_direction(p, q)), i)
                    })
                    .collect::<Result<_, _>>()?
            }
            // The planes through the edges from slope vertex i to the two vertices above, in the same way.
            TierRule::HighEdgePlane => {
                let (low, high) = (self.placed_tier(0), self.placed_tier(1));
                starts = low.to_vec();
                let face = |a: Vec3, b: Vec3, c: Vec3| unit((b - a).cross(&(c - a)));
                (0..n)
                    .map(|i| {
                        let j = after(i);
                        let (a, p, q) = (low[i], high[i], high[j]);
                        let left = face(base.points[i], a, p)
                            .and_then(|out| EdgePlane::new(a - p, -out, delta));
                        let right = face(base.points[j], q, a)
                            .and_then(|out| EdgePlane::new(q - a, -out, delta));
                        defined(
                            left.zip(right)
                                .and_then(|(p, q)| intersection_direction(p, q)),
                            i,
                        )
                    })
                    .collect::<Result<_, _>>()?
            }
            TierRule::Flank => {
                factor = 2f64.sqrt();
                let low = self.placed_tier(0);
                starts = base.points.clone();
                (0..n)
                    .map(|i| {
                        let middle = (low[before(i)] + low[i]) / 2.0;
                        defined(unit(middle - base.points[i]), i)
                    })
                    .collect::<Result<_, _>>()?
            }
            TierRule::Fold => {
                starts = base.points.iter().flat_map(|&b| [b, b]).collect();
                self.fold_directions(1)
            }
            TierRule::Refold => {
                starts = self.placed_tier(0).to_vec();
                self.fold_directions(2)
            }
            // The two points of each corner meet: one vertex from their mean along the mean of their directions.
            TierRule::Close => {
                let low = self.placed_tier(1);
                let folds = self.fold_directions(3);
                let pairs = low.chunks(2).zip(folds.chunks(2));
                let (tops, directions) = pairs
                    .map(|(p, d)| {
                        let middle = (p[0] + p[1]) / 2.0;
                        let rise = (d[0] + d[1]) / 2.0;
                        (middle + length * rise, unit(rise).unwrap_or(base.normal))
                    })
                    .unzip();
                self.directions = directions;
                return Ok(tops);
            }
        };
        let points = starts.iter().zip(&directions);
        let points = points.map(|(p, d)| p + factor * length * d).collect();
        self.directions = directions;
        Ok(points)
    }

    /// Outward unit normals of the triangles (`b_i`, b_(i+1), `low_i`); the error names a triangle without area.
    fn outward_normals(&self, low: &[Vec3]) -> Result<Vec<Vec3>, String> {
        let n = self.base.len();
        let p = &self.base.points;
        (0..n)
            .map(|i| {
                let (a, b) = (p[i], p[(i + 1) % n]);
                defined(unit((b - a).cross(&(low[i] - a))), i)
            })
            .collect()
    }

    /// For each corner the directions of fold `k` over the edges before and after it: cos(tau) N + sin(tau) W,
    /// tau = k delta - (2k - 1) 90 degrees.
    fn fold_directions(&self, k: u32) -> Vec<Vec3> {
        let n = self.base.len();
        let k = f64::from(k);
        let tau = k * self.delta - (2.0 * k - 1.0) * std::f64::consts::FRAC_PI_2;
        let over = |i: usize| tau.cos() * self.base.normal + tau.sin() * self.base.outward[i];
        (0..n)
            .flat_map(|i| [over((i + n - 1) % n), over(i)])
            .collect()
    }
}

/// The direction over corner `i`, or the reason that there is none.
fn defined(direction: Option<Vec3>, i: usize) -> Result<Vec3, String> {
    direction.ok_or_else(|| {
        format!("a tier has no direction over corner {i}: the faces of the tier below have no area there")
    })
}

/// Makes a tier planar: moves each vertex along its direction to the mean height over the base. Vertices whose
/// direction is parallel to the base, up to 1e-9, stay.
pub(super) fn level(base: &Polygon, top: &mut [Vec3], directions: &[Vec3]) {
    let centre = mean(&base.points);
    let height = |p: &Vec3| (p - centre).dot(&base.normal);
    let mean_height = top.iter().map(height).sum::<f64>() / top.len() as f64;
    for (p, d) in top.iter_mut().zip(directions) {
        let rise = d.dot(&base.normal);
        if rise.abs() > 1e-9 {
            *p += d * ((mean_height - height(p)) / rise);
        }
    }
}
