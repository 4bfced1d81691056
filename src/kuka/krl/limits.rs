//! Limits of this reader. They limit time, memory and recursion depth for any input; an input beyond a limit is
//! reported with its line.

/// The maximum size of one file, bytes.
pub(super) const FILE_BYTES: usize = 16 << 20;
/// The maximum nesting depth of blocks (IF, LOOP, SPLINE …).
pub(super) const BLOCK_DEPTH: usize = 100;
/// The maximum nesting depth of brackets, braces and signs in one expression.
pub(super) const EXPRESSION_DEPTH: usize = 100;
/// The maximum number of operators between two values on one line.
pub(super) const OPERATORS: usize = 200;
/// The maximum number of values in one array or structure; more do not fit into a controller's memory.
pub(super) const ARRAY_VALUES: usize = 10_000_000;
/// The maximum number of values that are allocated to execute a program, in all data lists together or in one routine.
pub(super) const MEMORY_VALUES: usize = 1_000_000;
/// The maximum size of a structure, in values and in components, of which aggregates are executed.
pub(super) const AGGREGATE_VALUES: usize = 256;
/// The maximum number of steps of an executable program; a larger program is only checked.
pub(super) const STEPS: usize = 2_000_000;
/// The maximum number of reported problems, and of warnings, for one file.
pub(super) const REPORTS: usize = 1_000;
/// The maximum number of names that a message lists.
pub(super) const MAX_LISTED: usize = 20;
