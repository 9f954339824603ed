// The address behind the `#`: what is shown is there again after a reload, and can be sent to others.
// `#QUERY`, `#QUERY/map/MAP`, `#QUERY/composition/COMPOSITION`, `#corpus`, `#corpus/EXAMPLE`.

const ID = /^[0-9A-Z]{26}$/;

export function route() {
  const [first, kind, id] = location.hash.slice(1).split("/");
  if (first === "corpus") return { view: "corpus", example: ID.test(kind ?? "") ? kind : null };
  if (!ID.test(first)) return { view: "bench", query: null };
  const known = ["map", "composition"].includes(kind) && ID.test(id ?? "");
  return { view: "bench", query: first, [known ? kind : "none"]: known ? id : null };
}

// Tells where the page is; `replace`: without a step that the browser's Back would undo.
export function go(hash, replace = true) {
  const to = `#${hash}`;
  if (location.hash === to || (!hash && !location.hash)) return;
  history[replace ? "replaceState" : "pushState"](null, "", hash ? to : location.pathname);
}
