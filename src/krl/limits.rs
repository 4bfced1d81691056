//! Limits of this reader. They bound time, memory and the depth of its recursion for any input; what lies beyond one is
//! reported with its line.

/// Bytes of one file.
pub(super) const FILE_BYTES: usize = 16 << 20;
/// Blocks (IF, LOOP, SPLINE …) inside each other.
pub(super) const BLOCK_DEPTH: usize = 100;
/// Brackets, braces and signs inside each other in one expression.
pub(super) const EXPRESSION_DEPTH: usize = 100;
/// Operators between two values on one line.
pub(super) const OPERATORS: usize = 200;
/// Values of one array or structure; more do not fit into a controller's memory.
pub(super) const ARRAY_VALUES: usize = 10_000_000;
/// Values of all data lists together, or of one routine, that are laid out for the execution.
pub(super) const MEMORY_VALUES: usize = 1_000_000;
/// Values, and components, of a structure with aggregates that are executed.
pub(super) const AGGREGATE_VALUES: usize = 256;
/// Steps of the execution; a program with more is checked only.
pub(super) const STEPS: usize = 2_000_000;
/// Reported problems, and warnings, of one file.
pub(super) const REPORTS: usize = 1_000;
/// Names that a message lists.
pub(super) const MAX_LISTED: usize = 20;
