// Follows a query's ranking as it is refined.

import { call, canStartAgain } from "/web/call.js";

// Server-sent events, read by hand so that the request can carry a token. `take(event)` is true after the last. A stream
// that breaks off is resumed.
export async function follow(id, signal, take) {
  let last = null;
  for (;;) {
    try {
      const headers = { accept: "text/event-stream", ...(last === null ? {} : { "last-event-id": last }) };
      const response = await call(`/v1/queries/${id}/stream?limit=50`, { headers, signal });
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (;;) {
        const { value, done } = await reader.read();
        if (done) break;
        text += value;
        const frames = text.split("\n\n");
        text = frames.pop();
        for (const frame of frames) {
          const field = (name) => frame.split("\n").find((line) => line.startsWith(`${name}: `))?.slice(name.length + 2);
          last = field("id") ?? last;
          if (field("data") && take(JSON.parse(field("data")))) return;
        }
      }
    } catch (error) {
      if (signal.aborted) return;
      if (error.code === "not_found" || canStartAgain(error)) throw error;
    }
    if (signal.aborted) return;
    await new Promise((resolve) => setTimeout(resolve, 1000));
  }
}
