//! The command lines that prepare a rendered cell for cycles, and its configuration if a production line requests the
//! cycles. Benches include this file, too.

/// The command that teaches the panel of the rendered cell.
pub const TEACH: &str = "teach --cell cell/cell.toml --recipe cell/recipe.toml --scan cell/taught_scan.pcd \
                     --corner cell/taught_corner.png --flange cell/taught_flange.json";

/// The commands that verify both cameras with the fixed boards, as every morning: first the scanner's board, then the
/// flange camera's board.
pub const VERIFY: [&str; 2] = [
    "calibrate verify --cell cell/cell.toml --camera scanner --board 5x4 --square-mm 40 \
     --target cell/target/scanner.toml --image cell/target/scanner.png",
    "calibrate verify --cell cell/cell.toml --camera flange-camera --board 5x4 --square-mm 40 \
     --target cell/target/flange_camera.toml --image cell/target/flange_camera.png --flange cell/target/flange.json",
];

/// The output signals to a simulated production line, as a part of the cell's file.
pub const LINE_OUTPUTS: &str = "[io.line_outputs]
ready = 40
cycle_done = 41
pass = 42
fail = 43
review = 44
fault = 45
";
/// The input signals from a simulated production line, with the first line of the table that they replace.
pub const LINE_INPUTS: [&str; 2] = ["[io.feedbacks]\n", "[io.feedbacks]\npart_present = 30\nstart_request = 31\n"];
