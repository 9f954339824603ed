//! Whole pictures: silhouettes, edges, hidden edges, hostile meshes.

use super::*;
use quadmuse_kernel::mesh::{Polygons, Vec3};

const CUBE: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

fn cube(faces: &[[u32; 4]]) -> PolyMesh {
    let sign = |k: u32, bit: u32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
    let positions = (0..8).map(|k| Vec3::new(sign(k, 0), sign(k, 1), sign(k, 2))).collect();
    PolyMesh { positions, faces: faces.iter().map(|f| &f[..]).collect(), ..PolyMesh::default() }
}

fn plain(yaw: f64, pitch: f64) -> View {
    View { poles: Poles::Unmarked, ..View::default() }.turned(yaw, pitch)
}

fn changed(a: &Picture, b: &Picture) -> Vec<(u32, u32)> {
    let all = (0..a.height()).flat_map(|y| (0..a.width()).map(move |x| (x, y)));
    all.filter(|&(x, y)| a.pixel(x, y) != b.pixel(x, y)).collect()
}

#[test]
fn a_cube_seen_from_the_front_covers_the_square_it_should() {
    let view = View { wires: Wires::Hidden, ..plain(0.0, 0.0) };
    let (empty, picture) = (render(&PolyMesh::default(), &view, 200), render(&cube(&CUBE), &view, 200));
    let covered = changed(&empty, &picture).len() as f64 / (200.0 * 200.0);
    assert!((covered - 0.81).abs() < 0.02, "90 % of either side are 81 % of the area, found {covered}");
}

#[test]
fn edges_of_polygons_are_drawn_and_diagonals_are_not() {
    let mesh = cube(&CUBE);
    let bare = render(&mesh, &View { wires: Wires::Hidden, ..plain(0.0, 0.0) }, 200);
    let wired = render(&mesh, &plain(0.0, 0.0), 200);
    let lines = changed(&bare, &wired);
    let near = |x: u32, y: u32| lines.iter().any(|&(a, b)| a.abs_diff(x) < 3 && b.abs_diff(y) < 3);
    assert!(near(10, 100) && near(190, 100) && near(100, 10) && near(100, 190), "the four front edges");
    assert!(!near(60, 60) && !near(140, 60) && !near(100, 100), "no diagonal, no hidden edge of the far side");
}

#[test]
fn a_segment_that_stands_out_keeps_its_clay_and_the_rest_does_not() {
    let mut mesh = cube(&CUBE);
    mesh.attributes.segments = Some(vec![0, 1, 0, 0, 0, 0]);
    let bare = |paint| render(&mesh, &View { wires: Wires::Hidden, paint, ..plain(0.6, 0.5) }, 200);
    let [all, front] = [bare(Paint::Clay), bare(Paint::Segment(1))];
    // The square in front is clay as ever, the two beside it are not.
    let seen = changed(&render(&PolyMesh::default(), &plain(0.6, 0.5), 200), &all).len();
    let others = changed(&all, &front).len();
    assert!(others > seen / 4 && others < 3 * seen / 4, "{others} of {seen} pixels");
    assert_eq!(changed(&all, &bare(Paint::Segment(7))).len(), seen, "all of it stands aside");
}

#[test]
fn an_edge_behind_the_surface_appears_once_the_surface_is_taken_away() {
    let closed = render(&cube(&CUBE), &plain(0.0, 0.0), 200);
    let open = cube(&CUBE.iter().copied().filter(|f| *f != CUBE[1]).collect::<Vec<_>>());
    let opened = render(&open, &plain(0.0, 0.0), 200);
    let wires_inside = |mesh: &PolyMesh, wired: &Picture| {
        let bare = render(mesh, &View { wires: Wires::Hidden, ..plain(0.0, 0.0) }, 200);
        changed(&bare, wired).into_iter().filter(|&(x, y)| (20..180).contains(&x) && (20..180).contains(&y)).count()
    };
    assert_eq!(wires_inside(&cube(&CUBE), &closed), 0);
    assert!(wires_inside(&open, &opened) > 200, "the far square and four slanting edges");
}

#[test]
fn the_poles_of_a_cube_are_marked_only_where_visible() {
    let blue = |faces: &[[u32; 4]]| {
        let marked = render(&cube(faces), &View { poles: Poles::Marked, ..plain(0.0, 0.0) }, 300);
        let bare = render(&cube(faces), &plain(0.0, 0.0), 300);
        let all = changed(&bare, &marked).into_iter().filter(|&(x, y)| marked.pixel(x, y) == [38, 96, 214]);
        // The far corners lie well within the near square.
        let (far, near): (Vec<_>, Vec<_>) = all.partition(|&(x, y)| (30..270).contains(&x) && (30..270).contains(&y));
        (near.len(), far.len())
    };
    let disc = std::f64::consts::PI * 4.5 * 4.5;
    let (near, far) = blue(&CUBE);
    assert!((3.0..5.0).contains(&(near as f64 / disc)), "four near corners, found {near} pixels");
    assert_eq!(far, 0, "no hidden corner");
    let opened: Vec<[u32; 4]> = CUBE.iter().copied().filter(|f| *f != CUBE[1]).collect();
    assert!(blue(&opened).1 as f64 / disc > 3.0, "the far corners show once the near face is gone");
}

#[test]
fn a_picture_decodes_to_its_own_pixels_and_is_the_same_every_time() {
    let picture = render(&cube(&CUBE), &View::default(), 96);
    let png = picture.to_png();
    assert_eq!(png, render(&cube(&CUBE), &View::default(), 96).to_png());
    let mut reader = png::Decoder::new(std::io::Cursor::new(&png)).read_info().expect("a PNG header");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
    reader.next_frame(&mut pixels).expect("a frame");
    assert_eq!(pixels, picture.bytes());
    let background = picture.pixel(1, 1);
    assert!(picture.bytes().chunks(3).any(|p| p != background));
}

#[test]
fn useless_meshes_give_a_picture_and_no_panic() {
    let mut degenerate = cube(&CUBE);
    degenerate.positions.iter_mut().for_each(|p| *p = Vec3::repeat(7.0));
    let mut infinite = cube(&CUBE);
    infinite.positions[3].y = f64::INFINITY;
    infinite.positions[5].x = f64::NAN;
    let mut huge = cube(&CUBE);
    huge.positions.iter_mut().for_each(|p| *p *= 1e308);
    let mut odd = cube(&[]);
    odd.faces = Polygons::default();
    [&[][..], &[1], &[1, 2], &[0, 0, 0], &[5, 6, 77], &[0, 1, 3, 2, 6, 7, 5]].iter().for_each(|f| odd.faces.push(f));
    for mesh in [degenerate, infinite, huge, odd, cube(&[])] {
        for view in [View::default(), View::guess(&mesh)] {
            assert_eq!(render(&mesh, &view, 0).width(), SIDE_MIN);
            render(&mesh, &view, 64);
        }
    }
}

#[test]
fn an_open_box_is_guessed_to_stand_on_its_opening() {
    // Without the face at -x the box stands on it: up is +x, snapped to the axis.
    let faces: Vec<[u32; 4]> = CUBE.iter().copied().filter(|f| *f != CUBE[4]).collect();
    let mut mesh = cube(&faces);
    mesh.positions.iter_mut().for_each(|p| p.y += 0.02 * p.x);
    assert_eq!(View::guess(&mesh).up, Vec3::x());
}

#[test]
fn a_model_that_stands_upright_is_seen_from_the_usual_side() {
    // Open above, like a foot at its ankle: not turned upside down.
    let faces: Vec<[u32; 4]> = CUBE.iter().copied().filter(|f| *f != CUBE[3]).collect();
    let view = View::guess(&cube(&faces));
    assert_eq!((view.up, view.front), (Vec3::y(), Vec3::z()));
    // Standing on an opening at −z, as programs with z up have it: faces −y.
    let faces: Vec<[u32; 4]> = CUBE.iter().copied().filter(|f| *f != CUBE[0]).collect();
    let view = View::guess(&cube(&faces));
    assert_eq!((view.up, view.front), (Vec3::z(), -Vec3::y()));
}

#[test]
fn a_tube_stands_along_its_length() {
    // Open at −x and +x: the openings' line is the x axis, and it is longer than they are wide.
    let faces: Vec<[u32; 4]> = CUBE.iter().copied().filter(|f| *f != CUBE[4] && *f != CUBE[5]).collect();
    let mut mesh = cube(&faces);
    mesh.positions.iter_mut().for_each(|p| *p = Vec3::new(4.0 * p.x, p.y * (1.0 + 0.2 * p.x), p.z * (1.0 + 0.2 * p.x)));
    assert_eq!(View::guess(&mesh).up, Vec3::x(), "the wider opening is up");
}

#[test]
fn the_inside_of_a_surface_is_painted_otherwise_than_its_outside() {
    let middle = |faces: &[[u32; 4]]| render(&cube(faces), &plain(0.0, 0.0), 100).pixel(50, 50);
    let [r, _, b] = middle(&CUBE);
    assert!(r > b, "warm clay outside");
    let opened: Vec<[u32; 4]> = CUBE.iter().copied().filter(|f| *f != CUBE[1]).collect();
    let [r, _, b] = middle(&opened);
    assert!(b > r, "cool inside");
}

#[test]
fn rounded_colours_stay_near_and_make_a_smaller_file() {
    let noise = |x: u32, y: u32| ((37 * x + 11 * y * y) % 7) as u8;
    let mut picture = Picture::filled(64, 64, [0; 3]);
    for y in 0..64 {
        (0..64).for_each(|x| picture.set(x, y, [120 + noise(x, y), 60 + noise(y, x), 200 + noise(x + y, y)]));
    }
    let rounded = picture.clone().rounded(5);
    let apart = |k: usize| {
        (0..64 * 64).map(|i| picture.pixel(i % 64, i / 64)[k].abs_diff(rounded.pixel(i % 64, i / 64)[k])).max()
    };
    assert!((0..3).all(|k| apart(k).is_some_and(|d| (1..=4).contains(&d))), "{:?}", (apart(0), apart(1), apart(2)));
    assert!(rounded.to_png().len() < picture.to_png().len());
    assert_eq!(picture.clone().rounded(8).to_png(), picture.to_png());
}
