// What the workbench shows, for all modules of it.

// `query`: the scan that is open: { id, name, segments, segment, rankings, ended, shown, laid, stop, … }; `onchange()` when its
// state did; `onpart(pane, face)` for a click on a part; `cut(query, like)` sends it again, cut into parts or as an
// example is, and
// `cutAs(query, mesh, labels, made)` cut as its faces are labelled, with the names of the labels; `goOn(query, id, wanted)` opens the
// same scan as the server has cut it.
export const bench = { viewer: null, query: null, onchange: () => {}, onpart: () => {}, cut: () => {}, cutAs: () => {}, goOn: () => {} };
