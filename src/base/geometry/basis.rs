//! B-spline basis functions of one parameter, with first and second derivatives.
//!
//! N_{i,0}(u) = 1 on [u_i, u_{i+1}), the last non-empty span closed;
//!     N_{i,p} = (u − u_i)/(u_{i+p} − u_i) N_{i,p−1} + (u_{i+p+1} − u)/(u_{i+p+1} − u_{i+1}) N_{i+1,p−1},   (4.10)
//! with 0/0 = 0. This is the Cox–de Boor recursion, in which p is the degree; the thesis mixes order and degree here.
//! Only the p + 1 functions that are not zero on the span of u are computed, so the quotients 0/0 never arise. The
//! derivative is
//!     N'_{i,p} = p ( N_{i,p−1}/(u_{i+p} − u_i) − N_{i+1,p−1}/(u_{i+p+1} − u_{i+1}) ).
//! Source: Piegl & Tiller, The NURBS Book, 2nd ed., sections 2.2 and 2.3.

use crate::number_text::list;
use std::ops::RangeInclusive;

/// Highest supported degree.
pub const MAX_DEGREE: usize = 5;
/// Degree of fitted surfaces and fields along each parameter.
pub const DEGREE: usize = 3;

/// One value for each of the `degree + 1` functions of a span; the rest of the array is zero.
pub type SpanValues = [f64; MAX_DEGREE + 1];

/// The reason why a list of knots is not a valid knot vector.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum KnotError {
    /// The degree is not supported.
    #[error("the spline has degree {found}, valid: 1 to {MAX_DEGREE}")]
    Degree {
        /// The requested degree.
        found: usize,
    },
    /// The knots are not open, decrease, or an inner knot has too high a multiplicity.
    #[error(
        "{} is not an open knot vector of degree {degree}: knots must be finite and must not decrease, both end \
         knots must occur degree + 1 times, and no other knot more than degree times",
        list(knots)
    )]
    NotOpen {
        /// The requested degree.
        degree: usize,
        /// The knots that were given.
        knots: Vec<f64>,
    },
}

/// An open knot vector with its degree (Eq. 4.9).
#[derive(Debug, Clone, PartialEq)]
pub struct KnotVector {
    degree: usize,
    knots: Vec<f64>,
}

/// The basis functions that are not zero at a parameter, with their derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Basis {
    /// Index of the control point that belongs to the first of these functions.
    pub first_control_index: usize,
    /// Values of the functions; they sum to 1.
    pub values: SpanValues,
    /// First derivatives of the functions; they sum to 0.
    pub first_derivatives: SpanValues,
    /// Second derivatives of the functions; they sum to 0.
    pub second_derivatives: SpanValues,
}

/// The basis functions of one span as polynomials of t = (u − start) / length: N_r = Σ_k c_rk t^k.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpanFunctions {
    /// The parameter where the span begins.
    pub start: f64,
    /// The length of the span in the parameter u.
    pub length: f64,
    /// The coefficients c_rk, function by function.
    pub coefficients: [SpanValues; MAX_DEGREE + 1],
}

impl KnotVector {
    /// Creates a knot vector from its knots.
    ///
    /// # Errors
    /// If the knots are not open or the degree is not supported.
    pub fn new(degree: usize, knots: Vec<f64>) -> Result<Self, KnotError> {
        if !(1..=MAX_DEGREE).contains(&degree) {
            return Err(KnotError::Degree { found: degree });
        }
        let count = knots.len();
        let open = count >= 2 * (degree + 1)
            && knots.iter().all(|knot| knot.is_finite())
            && knots.windows(2).all(|pair| pair[0] <= pair[1])
            && knots[degree] == knots[0]
            && knots[count - 1 - degree] == knots[count - 1]
            // The multiplicity p + 1 is allowed only for the two end knots.
            && knots[1..count - 1].windows(degree + 1).all(|run| run[0] < run[degree]);
        if open { Ok(KnotVector { degree, knots }) } else { Err(KnotError::NotOpen { degree, knots }) }
    }

    /// Creates a knot vector with equal spans over a domain.
    ///
    /// # Errors
    /// If the domain or the number of spans is empty, or the degree is not supported.
    pub fn uniform(degree: usize, spans: usize, domain: RangeInclusive<f64>) -> Result<Self, KnotError> {
        if spans == 0 {
            return Err(KnotError::NotOpen { degree, knots: Vec::new() });
        }
        let (low, high) = (*domain.start(), *domain.end());
        let inner = (1..spans).map(|i| low + (high - low) * i as f64 / spans as f64);
        let ends = |at: f64| std::iter::repeat_n(at, degree + 1);
        Self::new(degree, ends(low).chain(inner).chain(ends(high)).collect())
    }

    /// Returns the degree p of the spline.
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Returns the number of control points.
    pub fn controls(&self) -> usize {
        self.knots.len() - self.degree - 1
    }

    /// Returns the first and the last parameter.
    pub fn domain(&self) -> RangeInclusive<f64> {
        self.knots[0]..=self.knots[self.knots.len() - 1]
    }

    /// Returns the number of spans between successive knots, including empty spans. The spline is one polynomial on
    /// each span.
    pub fn spans(&self) -> usize {
        self.controls() - self.degree
    }

    /// Returns the index, from 0, of the span that contains a parameter. Outside of the domain, the index of the first
    /// or the last span.
    pub fn span(&self, at: f64) -> usize {
        let inner = &self.knots[self.degree + 1..self.controls()];
        let (low, high) = (self.knots[0], self.knots[self.knots.len() - 1]);
        // Spans are usually equal: the first guess is wrong by at most two spans.
        let mut span = ((at - low) / (high - low) * self.spans() as f64).max(0.0) as usize;
        span = span.min(inner.len());
        while span < inner.len() && inner[span] <= at {
            span += 1;
        }
        while span > 0 && inner[span - 1] > at {
            span -= 1;
        }
        span
    }

    /// Returns the basis functions of one span as polynomials.
    pub fn span_polynomials(&self, span: usize) -> SpanFunctions {
        let knot = span + self.degree;
        let (start, length) = (self.knots[knot], self.knots[knot + 1] - self.knots[knot]);
        let mut lower = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
        lower[0][0] = 1.0;
        // An empty span contains no parameter.
        let top = if length > 0.0 { self.degree } else { 0 };
        for degree in 1..=top {
            let mut raised = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
            for (r, function) in lower.iter().enumerate().take(degree) {
                let (from, to) = (self.knots[knot + r + 1 - degree], self.knots[knot + r + 1]);
                for (k, coefficient) in function.iter().enumerate().take(degree) {
                    let share = coefficient / (to - from); // Eq. 4.10 with u = start + length · t
                    raised[r][k] += (to - start) * share;
                    raised[r][k + 1] -= length * share;
                    raised[r + 1][k] += (start - from) * share;
                    raised[r + 1][k + 1] += length * share;
                }
            }
            lower = raised;
        }
        SpanFunctions { start, length, coefficients: lower }
    }

    /// Returns the Greville abscissa of each control point: the mean of its p inner knots.
    pub fn greville_abscissa(&self) -> Vec<f64> {
        let mean = |i: usize| self.knots[i + 1..=i + self.degree].iter().sum::<f64>() / self.degree as f64;
        (0..self.controls()).map(mean).collect()
    }

    /// Returns the values of the basis functions at a parameter, without derivatives.
    pub fn values(&self, at: f64) -> SpanValues {
        let knot = self.span(at) + self.degree;
        (1..=self.degree).fold(constant_values(), |lower, degree| self.raise_degree(lower, degree, knot, at))
    }

    /// Returns the values and first derivatives at a parameter; the second derivatives are left zero.
    pub fn with_first_derivatives(&self, at: f64) -> Basis {
        let (span, top) = (self.span(at), self.degree);
        let knot = span + top;
        let lower = (1..top).fold(constant_values(), |lower, degree| self.raise_degree(lower, degree, knot, at));
        Basis {
            first_control_index: span,
            values: self.raise_degree(lower, top, knot, at),
            first_derivatives: self.differentiate(lower, top, knot),
            second_derivatives: [0.0; MAX_DEGREE + 1],
        }
    }

    /// Returns the values, first and second derivatives at a parameter.
    pub fn with_second_derivatives(&self, at: f64) -> Basis {
        let (span, top) = (self.span(at), self.degree);
        let knot = span + top;
        if top == 1 {
            return self.with_first_derivatives(at);
        }
        let lowest =
            (1..top - 1).fold(constant_values(), |lower, degree| self.raise_degree(lower, degree, knot, at));
        let lower = self.raise_degree(lowest, top - 1, knot, at);
        Basis {
            first_control_index: span,
            values: self.raise_degree(lower, top, knot, at),
            first_derivatives: self.differentiate(lower, top, knot),
            second_derivatives: self.differentiate(self.differentiate(lowest, top - 1, knot), top, knot),
        }
    }

    // Applies one step of the recursion, Eq. 4.10: computes the functions of a degree from those of degree − 1, on the
    // span that begins at this knot.
    fn raise_degree(&self, lower: SpanValues, degree: usize, knot: usize, at: f64) -> SpanValues {
        let mut raised = [0.0; MAX_DEGREE + 1];
        for (r, value) in lower.iter().enumerate().take(degree) {
            let (from, to) = (self.knots[knot + r + 1 - degree], self.knots[knot + r + 1]);
            let share = value / (to - from);
            raised[r] += (to - at) * share;
            raised[r + 1] = (at - from) * share;
        }
        raised
    }

    fn differentiate(&self, lower: SpanValues, degree: usize, knot: usize) -> SpanValues {
        let mut slopes = [0.0; MAX_DEGREE + 1];
        for (r, value) in lower.iter().enumerate().take(degree) {
            let share = degree as f64 * value / (self.knots[knot + r + 1] - self.knots[knot + r + 1 - degree]);
            slopes[r] -= share;
            slopes[r + 1] = share;
        }
        slopes
    }
}

fn constant_values() -> SpanValues {
    let mut lowest = [0.0; MAX_DEGREE + 1];
    lowest[0] = 1.0;
    lowest
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Evaluates the recursion exactly as the documentation of this module states it, with 0/0 = 0 and the last
    /// non-empty span closed. This reference shares no code with the functions under test.
    fn cox_de_boor(knots: &[f64], i: usize, p: usize, u: f64) -> f64 {
        let last = knots[knots.len() - 1];
        if p == 0 {
            let inside = knots[i] <= u && u < knots[i + 1];
            let closed = u == last && knots[i] < last && knots[i + 1] == last;
            return if inside || closed { 1.0 } else { 0.0 };
        }
        let over = |a: f64, b: f64| if b == 0.0 { 0.0 } else { a / b };
        over(u - knots[i], knots[i + p] - knots[i]) * cox_de_boor(knots, i, p - 1, u)
            + over(knots[i + p + 1] - u, knots[i + p + 1] - knots[i + 1]) * cox_de_boor(knots, i + 1, p - 1, u)
    }

    /// Expected values, calculated by hand: inside a uniform cubic spline the values at a knot are 1/6, 4/6, 1/6, 0.
    /// The first derivatives are −1/2, 0, 1/2, 0 per span, and the second derivatives 1, −2, 1, 0.
    #[test]
    fn uniform_cubic_at_a_knot() {
        let knots = KnotVector::uniform(3, 8, 0.0..=8.0).expect("open");
        let basis = knots.with_second_derivatives(4.0);
        assert_eq!(basis.first_control_index, 4);
        for (found, expected) in [
            (basis.values, [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0, 0.0]),
            (basis.first_derivatives, [-0.5, 0.0, 0.5, 0.0]),
            (basis.second_derivatives, [1.0, -2.0, 1.0, 0.0]),
        ] {
            for r in 0..4 {
                assert!((found[r] - expected[r]).abs() < 1e-14, "{found:?}");
            }
        }
    }

    /// Expected values, calculated by hand: without inner knots the functions are the cubic Bernstein polynomials. At u
    /// = 1/2 they are 1/8, 3/8, 3/8, 1/8.
    #[test]
    fn without_inner_knots_the_functions_are_bernstein_polynomials() {
        let knots = KnotVector::uniform(3, 1, 0.0..=1.0).expect("open");
        for (r, expected) in [0.125, 0.375, 0.375, 0.125].into_iter().enumerate() {
            assert!((knots.values(0.5)[r] - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn the_ends_belong_to_the_domain() {
        let knots = KnotVector::uniform(3, 5, -0.1..=1.1).expect("open");
        assert_eq!((knots.span(-0.1), knots.span(1.1)), (0, 4));
        assert!((knots.values(-0.1)[0] - 1.0).abs() < 1e-15 && (knots.values(1.1)[3] - 1.0).abs() < 1e-15);
    }

    #[test]
    fn knots_that_are_not_open_or_decrease_are_refused() {
        assert!(matches!(KnotVector::uniform(0, 4, 0.0..=1.0), Err(KnotError::Degree { found: 0 })));
        assert!(matches!(KnotVector::uniform(3, 0, 0.0..=1.0), Err(KnotError::NotOpen { .. })));
        for knots in [
            vec![0.0, 0.0, 0.5, 1.0, 1.0, 1.0],
            vec![0.0, 0.0, 0.0, 0.7, 0.3, 1.0, 1.0, 1.0],
            vec![0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 1.0, 1.0, 1.0],
            vec![0.0, 0.0, 0.0, f64::NAN, 1.0, 1.0, 1.0],
            vec![0.0; 6],
        ] {
            assert!(matches!(KnotVector::new(2, knots), Err(KnotError::NotOpen { .. })));
        }
    }

    fn knot_vectors() -> impl Strategy<Value = KnotVector> {
        let gaps = prop::collection::vec(prop_oneof![Just(0.0), 0.05..1.0f64], 0..8);
        (1..=MAX_DEGREE, gaps).prop_filter_map("an inner knot too often", |(degree, gaps)| {
            let mut knots = vec![0.0; degree + 1];
            let mut at = 0.3;
            for gap in gaps {
                knots.push(at);
                at += gap;
            }
            knots.extend(std::iter::repeat_n(at + 0.4, degree + 1));
            KnotVector::new(degree, knots).ok()
        })
    }

    proptest! {
        #[test]
        fn bases_agree_with_the_recursion_and_sum_to_one(knots in knot_vectors(), share in 0.0..=1.0f64) {
            let at = knots.domain().end() * share;
            let basis = knots.with_second_derivatives(at);
            let count = knots.degree() + 1;
            prop_assert!((basis.values[..count].iter().sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert!(basis.first_derivatives.iter().sum::<f64>().abs() < 1e-9);
            prop_assert_eq!(knots.values(at), basis.values);
            for control in 0..knots.controls() {
                let local = control.checked_sub(basis.first_control_index).filter(|r| *r < count);
                let found = local.map_or(0.0, |r| basis.values[r]);
                prop_assert!((found - cox_de_boor(&knots.knots, control, knots.degree(), at)).abs() < 1e-12);
            }
        }

        #[test]
        fn polynomials_of_a_span_equal_its_functions(knots in knot_vectors(), share in 0.0..=1.0f64) {
            let at = knots.domain().end() * share;
            let functions = knots.span_polynomials(knots.span(at));
            let t = (at - functions.start) / functions.length;
            let values = knots.values(at);
            for (function, value) in functions.coefficients.iter().zip(values) {
                let found = function.iter().rev().fold(0.0, |sum, c| sum * t + c);
                prop_assert!((found - value).abs() < 1e-9, "{} {}", found, value);
            }
        }

        #[test]
        fn derivatives_agree_with_finite_differences(knots in knot_vectors(), share in 0.001..0.999f64) {
            let (at, step) = (knots.domain().end() * share, 1e-6);
            prop_assume!(knots.span(at - step) == knots.span(at + step));
            let (before, basis, after) =
                (knots.with_second_derivatives(at - step), knots.with_second_derivatives(at), knots.with_second_derivatives(at + step));
            for r in 0..=knots.degree() {
                let first = (after.values[r] - before.values[r]) / (2.0 * step);
                let second = (after.first_derivatives[r] - before.first_derivatives[r]) / (2.0 * step);
                let scale = 1.0 + basis.second_derivatives[r].abs();
                prop_assert!((first - basis.first_derivatives[r]).abs() < 1e-5 * scale, "{} {}", first, basis.first_derivatives[r]);
                prop_assert!((second - basis.second_derivatives[r]).abs() < 1e-3 * scale * scale);
            }
        }
    }
}
