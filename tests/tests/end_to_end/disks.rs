//! Disks and limits that take nothing more: what is there is served, what is new is refused, and the server lives on.

use crate::Place;
use quadmuse_tests::{http, server::Server};

/// Largest file that the limited server may write, in the 512 bytes that `ulimit -f` counts.
const FILE_BLOCKS: u32 = 40_960;

/// A mesh of about so many bytes, different for each number.
fn mesh(number: usize, bytes: usize) -> Vec<u8> {
    let mut text = format!("v 0 0 {number}\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").into_bytes();
    while text.len() < bytes {
        text.extend_from_slice(b"# what nobody reads makes it longer, and so the file that it is kept in\n");
    }
    text
}

#[test]
fn a_limit_on_the_size_of_files_refuses_what_is_too_large_and_ends_nothing() {
    let place = Place::new();
    let script = format!("ulimit -f {FILE_BLOCKS}; exec \"$0\" \"$@\"");
    let mut server = Server::start_under(&["sh", "-c", &script], &place.data()).expect("a server");
    let add = |bytes: &[u8]| http::post(server.address(), "/v1/examples", "model/obj", bytes).expect("an answer");
    let small = add(&mesh(0, 0));
    assert_eq!(small.status, 201, "{}", small.text());
    let large = add(&mesh(1, 24 << 20));
    assert!([503, 507].contains(&large.status), "{} {}", large.status, large.text());
    let listed = http::get(server.address(), "/v1/examples").expect("a list").text();
    assert_eq!(listed.matches("\"id\"").count(), 1, "{listed}");
    let next = add(&mesh(2, 0));
    assert_eq!(next.status, 201, "a small one is taken again: {}", next.text());
    assert!(server.is_alive(), "{}", server.log());
}
