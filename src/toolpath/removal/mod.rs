//! The depth that the disc removes: a model of the removal, its calibration, and the feeds that make the depth uniform.
//!
//! # Symbols
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | h | depth removed, along the surface's normal | mm; µm for people |
//! | k, k₀ | Preston's coefficient; of a new disc | mm²/N |
//! | p | pressure between disc and panel | N/mm² |
//! | v | speed of an abrasive grain over the panel, mean over an orbit | mm/s |
//! | u, f | speed on the orbit, π · diameter · rotation speed; feed | mm/s |
//! | F | force of the tool along the surface's normal | N |
//! | s | stiffness of the pad: its modulus divided by its thickness | N/mm³ |
//! | δ, c | compression of the pad in the disc's middle; at a point | mm |
//! | w, b | area that the disc has swept; decay of ln k with w | mm²; 1/mm² |
//!
//! # The model
//!
//! The depth grows by                      dh/dt = k p v                                               (1, Preston)
//! with the grain's mean speed             v = (1/2π) ∮ |u + f| dφ                                     (2, `speed`)
//! and a disc that wears                   k = k₀ exp(−b w),                                           (3, `model`)
//! with w the area that the store counts for the present disc: its diameter times its path length in contact. The pad
//! is an elastic foundation: each of its points yields independently, and the pressure is never negative,
//!                                         p = s · max(c, 0) where there is panel below the disc,      (4, `pad`)
//!                                         c = δ + t·x − ½ xᵀ K x,
//! with x the position in the tangent plane, K the surface's curvature at this point (`track`), t the tilt of the disc
//! against the tangent plane.
//! δ follows from                          ∫ p dA = F.                                                 (5)
//! The tilt is that of the tool: the arm holds the tool's orientation, and a force-controlled tool moves along its axis
//! alone. The arm bears the moments of p about the disc's middle; the disc does not rotate to balance them. A disc on a
//! ball joint would need two more equations, and is not covered by this model.
//!
//! The disc's rim takes part in the orbital motion, so p is averaged over the circle of the orbit's radius (`pad`).
//! Over a straight segment of the path all of this is integrated in closed form, so that a few segments are as exact as
//! many short steps. A random-orbit sander also rotates the disc about its own axis; this rotation is slow and is
//! neglected.
//!
//! # The uncertainty
//!
//! ln k₀ and b have a covariance from the coupons (`fit`). The coupons scatter by σ_r, and their discs by σ_d; the
//! force has an error of σ_F. All these errors act on the whole depth of a point, so that
//!     σ²(ln h) = var(ln k₀) − 2 w cov(ln k₀, b) + w² var(b) + σ_r² + σ_d² + σ_F²,                       (6, `model`)
//! and 95 % of the points lie within h · exp(± q σ), with q Student's quantile for the coupons' degrees of freedom.
//!
//! # Sources
//!
//! (1) Preston, J. Soc. Glass Technol. 11, 1927. (4) Winkler's foundation: Johnson, Contact Mechanics, Cambridge 1985,
//! 4.3. No negative pressure beyond an edge: as for polishing tools that extend over an edge, Luna-Aguilar et al.,
//! Proc. SPIE 4840, 2003, which shows that negative pressures are wrong.
//!
//! Files: `speed`, `pad`, `model` the physics · `track` the segments of a path · `map` the removal by the segments, for
//! each point · `figures` the figures of a map · `schedule` the feeds that make the depth uniform · `ground` where
//! there is panel material · `coupons`, `table` measured depths · `fit`, `power`, `gate` the estimate of k from these
//! depths, and whether it may be used. No I/O and no clock. Lengths in mm and forces in N.

pub mod coupons;
#[cfg(any(test, feature = "testing"))]
#[cfg_attr(feature = "testing", allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
pub mod examples;
pub mod figures;
pub mod fit;
pub mod gate;
pub mod ground;
pub mod map;
pub mod model;
pub mod pad;
pub mod power;
pub mod schedule;
pub mod speed;
pub mod table;
pub mod track;
