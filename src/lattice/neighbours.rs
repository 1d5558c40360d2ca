//! The 26 neighbours of a particle, and how a particle's springs are kept as bits.
//!
//! Direction `d` of a particle counts its neighbours x fastest, then y, then z, leaving the particle itself out. The
//! opposite of `d` is `25 - d`; the 13 directions from [`FIRST_FORWARD`] on point to larger linear indices, so each
//! spring is named once by its lower particle and a forward direction.

/// Number of neighbours of a particle inside the lattice.
pub const NEIGHBOURS: usize = 26;

/// First direction that points to a larger linear index; directions from here to 25 name every spring once.
pub const FIRST_FORWARD: usize = 13;

/// All 26 springs of a particle alive.
pub const ALL_ALIVE: u32 = (1 << NEIGHBOURS) - 1;

/// Offset (i, j, k) of the neighbour in each direction [pitches].
pub const OFFSETS: [[i32; 3]; NEIGHBOURS] = offsets();

const fn offsets() -> [[i32; 3]; NEIGHBOURS] {
    let mut offsets = [[0; 3]; NEIGHBOURS];
    let mut direction = 0;
    let mut place = 0;
    while place < 27 {
        if place != 13 {
            offsets[direction] = [place % 3 - 1, place / 3 % 3 - 1, place / 9 - 1];
            direction += 1;
        }
        place += 1;
    }
    offsets
}

/// The direction back from the neighbour in `direction`.
pub const fn opposite(direction: usize) -> usize {
    NEIGHBOURS - 1 - direction
}

/// The direction of an offset whose entries are -1, 0 or 1.
///
/// # Panics
/// If the offset is zero or not one of the 26.
pub const fn direction_of(offset: [i32; 3]) -> usize {
    assert!(offset[0].abs() <= 1 && offset[1].abs() <= 1 && offset[2].abs() <= 1);
    let place = ((offset[2] + 1) * 9 + (offset[1] + 1) * 3 + offset[0] + 1) as usize;
    assert!(place != 13, "a particle is not its own neighbour");
    if place < 13 { place } else { place - 1 }
}

/// How many of the three indices a direction changes: 1 face, 2 face diagonal, 3 body diagonal.
pub const fn family(direction: usize) -> usize {
    let [i, j, k] = OFFSETS[direction];
    (i.abs() + j.abs() + k.abs()) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_and_offsets_agree() {
        for direction in 0..NEIGHBOURS {
            let offset = OFFSETS[direction];
            assert_eq!(direction_of(offset), direction);
            assert_eq!(OFFSETS[opposite(direction)], offset.map(|o| -o));
            let forward = (offset[2], offset[1], offset[0]) > (0, 0, 0);
            assert_eq!(direction >= FIRST_FORWARD, forward);
        }
        let count = |f| (0..NEIGHBOURS).filter(|&d| family(d) == f).count();
        assert_eq!([count(1), count(2), count(3)], [6, 12, 8]);
    }
}
