//! How the corners, edges and faces of a cell are numbered.
//!
//! Corner `c` has the offsets `(c & 1, c >> 1 & 1, c >> 2)`. With `b = axis + 1` and `c = axis + 2` (modulo 3), edge
//! `4 axis + pb + 2 pc` runs along `axis` at the place `(pb, pc)` of the other two; face `2 axis + side` is normal to `axis`.
//! A face lists its corners as a ring `(0,0) (1,0) (1,1) (0,1)` in `(b, c)`: counter-clockwise seen from `+axis`, and
//! the same for the two cells that share the face.

/// Lower and upper corner of each edge.
pub(crate) const EDGES: [[u8; 2]; 12] = edges();
/// Corners of each face, as a ring.
pub(crate) const RINGS: [[u8; 4]; 6] = rings();
/// Edges of each face: entry `m` joins the ring corners `m` and `m + 1`.
pub(crate) const RING_EDGES: [[u8; 4]; 6] = ring_edges();
/// The two faces at each edge, one bit per face.
pub(crate) const EDGE_FACES: [u8; 12] = edge_faces();

const fn edges() -> [[u8; 2]; 12] {
    let mut edges = [[0; 2]; 12];
    let mut edge = 0;
    while edge < 12 {
        let axis = edge / 4;
        let low = ((edge & 1) << ((axis + 1) % 3)) | ((edge >> 1 & 1) << ((axis + 2) % 3));
        edges[edge] = [low as u8, (low | 1 << axis) as u8];
        edge += 1;
    }
    edges
}

const fn rings() -> [[u8; 4]; 6] {
    let mut rings = [[0; 4]; 6];
    let mut face = 0;
    while face < 6 {
        let axis = face / 2;
        let (b, c) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        let base = (face % 2) << axis;
        rings[face] = [base as u8, (base | b) as u8, (base | b | c) as u8, (base | c) as u8];
        face += 1;
    }
    rings
}

const fn ring_edges() -> [[u8; 4]; 6] {
    let mut result = [[0; 4]; 6];
    let mut at = 0;
    while at < 24 {
        let (face, m) = (at / 4, at % 4);
        let (one, two) = (RINGS[face][m], RINGS[face][(m + 1) % 4]);
        let mut edge = 0;
        while edge < 12 {
            let [low, high] = EDGES[edge];
            if (low == one && high == two) || (low == two && high == one) {
                result[face][m] = edge as u8;
            }
            edge += 1;
        }
        at += 1;
    }
    result
}

const fn edge_faces() -> [u8; 12] {
    let mut faces = [0; 12];
    let mut at = 0;
    while at < 24 {
        faces[RING_EDGES[at / 4][at % 4] as usize] |= 1 << (at / 4);
        at += 1;
    }
    faces
}

/// Offsets (x, y, z) of a corner.
pub(crate) const fn corner_offset(corner: u8) -> [usize; 3] {
    [(corner & 1) as usize, (corner >> 1 & 1) as usize, (corner >> 2) as usize]
}

/// Which of the four faces around an edge a cell's face is: 0 and 1 reach to `+b` and `-b` from the edge, 2 and 3 to
/// `+c` and `-c`, where b and c follow the edge's axis. The same for every cell at the edge.
pub(crate) const fn face_slot(face: u8, edge: u8) -> u8 {
    let (axis, normal) = (edge / 4, face / 2);
    // The face spans the edge and the one axis that is neither the edge's nor the face's normal.
    let reach_is_c = (axis + 1) % 3 == normal;
    let place = if reach_is_c { edge >> 1 & 1 } else { edge & 1 };
    if reach_is_c { 2 + place } else { place }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_edge_has_two_faces_and_every_face_four_edges() {
        for edge in 0..12 {
            assert_eq!(EDGE_FACES[edge].count_ones(), 2);
            assert_eq!(EDGES[edge][0] ^ EDGES[edge][1], 1 << (edge / 4));
        }
        for face in 0..6 {
            for m in 0..4 {
                let edge = RING_EDGES[face][m];
                let mut ends = EDGES[usize::from(edge)];
                let mut ring = [RINGS[face][m], RINGS[face][(m + 1) % 4]];
                ends.sort_unstable();
                ring.sort_unstable();
                assert_eq!(ends, ring);
            }
        }
    }

    #[test]
    fn the_two_faces_of_a_cell_at_an_edge_have_different_slots() {
        for edge in 0..12_u8 {
            let slots: Vec<u8> = (0..6)
                .filter(|face| EDGE_FACES[usize::from(edge)] >> face & 1 == 1)
                .map(|face| face_slot(face, edge))
                .collect();
            // The face that reaches along b lies at slot 0 or 1, the one along c at 2 or 3.
            assert_eq!(slots.iter().map(|s| s / 2).sum::<u8>(), 1, "{slots:?}");
        }
    }
}
