// Undo and redo: each state of a map that was shown, with its points, as a stack.

import { send, json } from "/web/call.js";

const DEPTH_MAX = 100;

// A new state: whatever was undone is gone.
export function record(query, map) {
  const last = query.past[query.at];
  if (last && last.id === map.id && last.revision === map.revision) return;
  query.past.splice(query.at + 1);
  query.past.push(map);
  if (query.past.length > DEPTH_MAX) query.past.shift();
  query.at = query.past.length - 1;
}

export const canUndo = (query) => query.at > 0;
export const canRedo = (query) => query.at < query.past.length - 1;

const same = (a, b) => Math.hypot(...a.map((x, k) => x - b[k])) <= 1e-9 * (1 + Math.hypot(...a));

// The edit that leads from points to others of the same map; null where they are the same.
export function between(now, then) {
  const before = new Map(now.map((c) => [c.id, c]));
  const ids = new Set(then.map((c) => c.id));
  const edit = { set: [], remove: [], undo: [], added: [] };
  for (const c of now) if (!ids.has(c.id)) (c.origin === "feature" ? edit.remove : edit.undo).push(c.id);
  for (const c of then) {
    const old = before.get(c.id);
    const isSame = old && same(old.on_input.point, c.on_input.point) && same(old.on_example.point, c.on_example.point);
    if (isSame && old.origin === c.origin) continue;
    if (c.origin === "feature") edit.undo.push(c.id);
    else if (old) edit.set.push({ id: c.id, on_example: c.on_example.point, on_input: c.on_input.point });
    else { edit.set.push({ on_example: c.on_example.point, on_input: c.on_input.point }); edit.added.push(c.id); }
  }
  return edit.set.length + edit.remove.length + edit.undo.length ? edit : null;
}

// What was removed comes back under a new id: older and newer states are to know it by that.
function rename(query, added, now, ids) {
  const fresh = now.constraints.filter((c) => !ids.has(c.id)).map((c) => c.id);
  added.forEach((id, k) => {
    if (!fresh[k]) return;
    for (const map of query.past) for (const c of map.constraints) if (c.id === id && map.id === now.id) c.id = fresh[k];
  });
}

// Goes `by` steps; answers with the map as it then is, or null.
export async function step(query, by) {
  const to = query.past[query.at + by];
  if (!to) return null;
  const path = `/v1/queries/${query.id}/maps/${to.id}`;
  const now = await json(path);
  const edit = between(now.constraints, to.constraints);
  let map = now;
  if (edit) {
    const { added, ...change } = edit;
    map = await send(`${path}/constraints`, change, "PATCH");
    rename(query, added, map, new Set(now.constraints.map((c) => c.id)));
  }
  query.at += by;
  query.past[query.at] = map;
  return map;
}
