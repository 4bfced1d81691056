//! All integration tests: one binary, because each one links OpenCV.

mod locate;
