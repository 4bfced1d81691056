//! Before the film is watched: the dry brightness, what the film leaves of it, and which pixels are wet.

use super::Model;
use super::WIDE_Q10;
