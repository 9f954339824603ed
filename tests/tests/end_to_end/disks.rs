//! Disks and limits that take nothing more: what is there is served, what is new is refused, and the server lives on.

use crate::Place;
use quadmuse_tests::{http, server::Server};
use std::time::{Duration, Instant};

/// Largest file that the limited server may write, in the 512 bytes that `ulimit -f` counts.
const FILE_BLOCKS: u32 = 40_960;

/// Size of the small disk: the store with its reserve and the room kept for a start on a full disk.
const DISK_SIZE: &str = "320m";

/// How long a server may take to write again when there is space: a hang ends here.
const RESUME: Duration = Duration::from_secs(60);

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

/// The file that lets the disk of [`filled`] have its space back.
const FREE: &str = "free";

/// Runs a server on a small disk of its own: the store in `data` is copied there, whatever is left is filled, and the filling is
/// removed when `free` is there.
const FILLED: &str = r#"
free=$1; data=$2; size=$3; shift 3
cp -a "$data" "$data.copy" && mount -t tmpfs -o size="$size" none "$data" && cp -a "$data.copy/." "$data/" || exit 77
cat /dev/zero > "$data/filler" 2>/dev/null
(while [ ! -e "$free" ]; do sleep 0.1; done; rm "$data/filler") &
exec "$@"
"#;

#[test]
fn a_start_on_a_full_disk_serves_what_is_there_and_writes_again_when_space_returns() {
    let may_mount = std::process::Command::new("unshare").args(["--mount", "--map-root-user", "true"]).status();
    if !may_mount.is_ok_and(|status| status.success()) {
        println!("passed over: no file system may be mounted here");
        return;
    }
    let place = Place::new();
    let kept = {
        let (mut server, client) = place.serve();
        let kept = crate::values(&client, &["add"], &[&place.heads(1)[0]]).remove(0);
        server.terminate(Duration::from_secs(60)).expect("it ends");
        crate::text(&kept, "id").to_owned()
    };
    let (free, data) = (place.path(FREE), place.data());
    let words = ["unshare", "--mount", "--map-root-user", "sh", "-c", FILLED, "sh"];
    let [free_word, data_word] = [&free, &data].map(|path| path.to_str().expect("a name of letters").to_owned());
    let words = [&words[..], &[&free_word, &data_word, DISK_SIZE]].concat();
    let mut server = Server::start_under(&words, &data).expect("a server that starts on a full disk");
    let add = |number| http::post(server.address(), "/v1/examples", "model/obj", &mesh(number, 0)).expect("an answer");
    let refused = add(1);
    assert_eq!(refused.status, 507, "{}", refused.text());
    let listed = http::get(server.address(), "/v1/examples").expect("a list").text();
    assert!(listed.contains(&kept), "{listed}");
    let ranked = http::post(server.address(), "/v1/queries", "model/obj", &mesh(2, 0)).expect("an answer");
    assert!(ranked.status < 300, "queries go on: {} {}", ranked.status, ranked.text());
    std::fs::write(&free, "").expect("writes");
    let begun = Instant::now();
    let taken = loop {
        let answer = add(1);
        if answer.status == 201 || begun.elapsed() > RESUME {
            break answer;
        }
        std::thread::sleep(Duration::from_millis(100));
    };
    assert_eq!(taken.status, 201, "{}", taken.text());
    assert!(server.is_alive(), "{}", server.log());
}
