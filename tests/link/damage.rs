//! Messages that a correct client never sends: commands that must be refused, documents with a missing element,
//! requests with arbitrary numbers.

use rand::RngExt;
use rand_pcg::Pcg64;

/// Number of the input that the controller maps to a flag.
pub const MAPPED_INPUT: u16 = 33;

/// Commands that the programs refuse in every state: operation, N1, N2, R1, R2 and the first value of P.
#[rustfmt::skip] // a row for each command
const REFUSED: [(i32, i32, i32, f32, f32, f32); 27] = [
    (0, 0, 0, 0.0, 0.0, 0.0), (9, 0, 0, 0.0, 0.0, 0.0), (99, 0, 0, 0.0, 0.0, 0.0),
    (1, 0, 0, 50.0, 0.0, 171.0), (1, 0, 0, 0.5, 0.0, 0.0), (1, 0, 0, 101.0, 0.0, 0.0), (1, 0, 0, 50.0, 1.0, 0.0),
    (2, -1, 0, 0.0, 0.0, 0.0), (2, 0, 2, 0.0, 0.0, 0.0), (2, 0, 0, -1.0, 0.0, 0.0), (2, 0, 0, 0.0, -1.0, 0.0),
    (2, 0, 0, 0.0, 2.5, 0.0), (4, 2, 0, 0.0, 0.0, 0.0),
    (5, 50, 50, 0.0, 1.0, 0.0), (5, 50, 50, 2.5, 1.0, 0.0), (5, 50, 50, 0.1, 0.0, 0.0), (5, 50, 50, 0.1, 11.0, 0.0),
    (5, 0, 50, 0.1, 1.0, 0.0), (5, 50, 101, 0.1, 1.0, 0.0),
    (6, 99, 1, 0.0, 0.0, 0.0), (6, 1, 2, 0.0, 0.0, 0.0), (6, 1, 1, 0.5, 0.0, 0.0),
    (7, 99, 1, 0.0, 0.0, 0.0), (7, MAPPED_INPUT as i32, 2, 0.0, 0.0, 0.0),
    (8, -1, 0, 0.0, 0.0, 0.0), (8, 7, 0, 0.0, 0.0, 0.0), (13, 0, 0, 0.0, 0.0, 0.0),
];

fn document(epoch: i32, id: i32, (operation, n1, n2, r1, r2, x): (i32, i32, i32, f32, f32, f32)) -> String {
    format!(
        "<Cmd Id=\"{id}\" Ep=\"{epoch}\" Op=\"{operation}\" N1=\"{n1}\" N2=\"{n2}\" R1=\"{r1:.3}\" R2=\"{r2:.3}\">\
         <P X=\"{x:.3}\" Y=\"-90.0\" Z=\"90.0\" A=\"0.0\" B=\"90.0\" C=\"0.0\"></P></Cmd>"
    )
}

/// Returns commands and requests that arrive together, for a controller in this epoch that has received this number of
/// commands; `Ok` is for the command channel, `Err` for the state channel.
pub fn documents(draw: &mut Pcg64, epoch: i32, received: i32) -> Vec<Result<String, String>> {
    let next = epoch.saturating_add(1);
    let request = |operation: i32, number: i32| {
        Err(format!("<Req Id=\"1\" Ep=\"0\" Op=\"{operation}\" N1=\"{number}\"></Req>"))
    };
    let refused = REFUSED[draw.random_range(0..REFUSED.len())];
    let good = (6, 1, 0, 0.0, 0.0, 0.0);
    match draw.random_range(0..16) {
        0..6 => vec![Ok(document(epoch, received + 1, refused))],
        // A command whose ID is not the next one; a command of another epoch; a command of an epoch that has ended.
        6 => vec![Ok(document(epoch, received + 2, good))],
        7 => vec![Ok(document(next, 1, good))],
        8 => vec![Ok(document(epoch - 1, received + 1, good))],
        // A line before base and tool are set; contact with tool number 0; a line outside of the box; a contact point
        // too far away.
        9 => vec![request(12, next), Ok(document(next, 1, (2, 0, 0, 0.0, 0.0, 0.0)))],
        10 => {
            let (tool, contact, x) = [(0, 1, 0.0), (0, 0, 20_000.0), (1, 1, 5_000.0)][next.rem_euclid(3) as usize];
            vec![
                request(12, next),
                Ok(document(next, 1, (3, 0, 0, 0.0, 0.0, 0.0))),
                Ok(document(next, 2, (4, tool, 0, 0.0, 0.0, 0.0))),
                Ok(document(next, 3, (2, 0, contact, 0.0, 0.0, x))),
            ]
        }
        // More commands than the ring buffer holds, after slow subroutines.
        11 => std::iter::once(request(12, next))
            .chain((1..=104).map(|id| Ok(document(next, id, (8, 0, 0, 0.0, 0.0, 0.0)))))
            .collect(),
        12 => vec![Ok(format!("<Cmd Id=\"{}\" Ep=\"{epoch}\" Op=\"6\" N2=\"0\"></Cmd>", received + 1))],
        // A line in the air that is longer than a step, after the client's own commands: the tool may be running.
        13 if received % 2 == 1 => vec![Ok(document(epoch, received + 1, (2, 0, 0, 0.0, 0.0, 20_000.0)))],
        13 => vec![Err("<Req Id=\"1\" Op=\"10\"></Req>".to_owned())],
        14 => vec![request(12, next), request(12, next.saturating_add(1))],
        _ => {
            let number = [i32::MIN, -1, 0, next, 1_000_000, i32::MAX - 1, i32::MAX][draw.random_range(0..7)];
            vec![request(draw.random_range(9..13), number)]
        }
    }
}
