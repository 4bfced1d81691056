//! The depth that the disc removes: a model of the removal, its calibration, and the feeds that make it even.
//!
//! # Symbols
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | h | depth removed, along the surface's normal | mm; µm for people |
//! | k, k₀ | Preston's coefficient; of a new disc | mm²/N |
//! | p | pressure between disc and panel | N/mm² |
//! | v | speed of an abrasive grain over the panel, mean over an orbit | mm/s |
//! | u, f | speed on the orbit, π · diameter · speed; feed | mm/s |
//! | F | force of the tool along the surface's normal | N |
//! | s | stiffness of the pad: its modulus over its thickness | N/mm³ |
//! | δ, c | compression of the pad in the disc's middle; at a place | mm |
//! | w, b | area that the disc has swept; decay of ln k by it | mm²; 1/mm² |
//!
//! # The model
//!
//! The depth grows by                      dh/dt = k p v                                               (1, Preston)
//! with the grain's mean speed             v = (1/2π) ∮ |u + f| dφ                                     (2, `speed`)
//! and a disc that wears                   k = k₀ exp(−b w),                                           (3, `model`)
//! w being the area that the store counts for the disc in use: its diameter times the way in contact. The pad is an
//! elastic foundation: each of its places yields independently, and never pulls,
//!                                         p = s · max(c, 0) below the disc where there is panel,      (4, `pad`)
//!                                         c = δ + t·x − ½ xᵀ K x,
//! x being the place in the tangent plane, K the surface's curvature there (`track`), t the tilt of the disc
//! against that plane.
//! δ follows from                          ∫ p dA = F.                                                 (5)
//! The tilt is the tool's: the arm holds its attitude, and a force-controlled tool moves along its axis alone. So
//! the arm bears the moments of p about the disc's middle, and they are not balanced by a turn of the disc. A disc
//! on a ball joint would need two more equations, and is not this model.
//!
//! While the disc wobbles on its orbit, its rim does too: p is averaged over the circle of the orbit's radius
//! (`pad`). Over a straight segment of path all of this integrates in closed form, so a few segments are as exact as
//! many short steps. A random orbit also turns the disc about its own axis; this is slow and not counted.
//!
//! # The uncertainty
//!
//! ln k₀ and b come with their covariance from coupons (`fit`), which also differ among themselves by σ_r, and their
//! discs by σ_d; the force has an error of σ_F. All parts act on the whole of a place's depth, so that
//!     σ²(ln h) = var(ln k₀) − 2 w cov(ln k₀, b) + w² var(b) + σ_r² + σ_d² + σ_F²,                       (6, `model`)
//! and 95 % of places lie within h · exp(± q σ), q being Student's for the coupons' redundancy.
//!
//! # Sources
//!
//! (1) Preston, J. Soc. Glass Technol. 11, 1927. (4) Winkler's foundation: Johnson, Contact Mechanics, Cambridge
//! 1985, 4.3. Without negative pressure beyond an edge: as for polishing tools that extend over it, Luna-Aguilar et
//! al., Proc. SPIE 4840, 2003, where pressures that pull are shown to be wrong.
//!
//! Files: `speed`, `pad`, `model` the physics · `track` the segments of a path · `map` their removal, place by place ·
//! `figures` its numbers · `schedule` the feeds that make it even · `ground` where there is panel · `coupons`, `table`
//! measured depths · `fit`, `power`, `gate` their result for k, and whether it may be used. No I/O and
//! no clock. Lengths in mm and forces in N.

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
