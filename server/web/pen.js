// A line that is drawn over the scan: it is shown while it is drawn, and told by samples of what lies under it.

// So near to the scan (in CSS pixels) a line may begin beside it.
const NEAR = 28;
// How close together samples of a line are, in CSS pixels, and how many there are at most: each asks all triangles.
const SAMPLE_PX = 4;
const SAMPLES_MAX = 64;

export class Pen {
  constructor(viewer) { Object.assign(this, { viewer, line: null, ink: null }); }

  // Begins a line, unless the pointer is far from the scan: whoever drags there turns it.
  begin(event) {
    const turns = [...Array(8).keys()].map((k) => (k * Math.PI) / 4);
    const around = turns.map((a) => ({ clientX: event.clientX + NEAR * Math.cos(a), clientY: event.clientY + NEAR * Math.sin(a) }));
    const { viewer } = this;
    const isNear = viewer.paneAt(event).name === "result" && [event, ...around].some((at) => viewer.under(at));
    this.line = isNear ? [this.place(event)] : null;
    return isNear;
  }

  go(event) {
    this.line.push(this.place(event));
    this.draw();
  }

  // The samples of the line; null of a mere click, and where a second finger came (no event).
  end(event) {
    const { line } = this;
    this.line = null;
    this.draw();
    return event && line.length > 2 ? this.sampled(line) : null;
  }

  place(event) {
    const { left, top } = this.viewer.canvas.getBoundingClientRect();
    return { x: event.clientX - left, y: event.clientY - top };
  }

  draw() {
    if (!this.ink) {
      this.viewer.marks.insertAdjacentHTML("afterend", '<svg class="stroke" aria-hidden="true"><polyline/><polyline/></svg>');
      this.ink = this.viewer.marks.nextElementSibling;
    }
    const points = (this.line ?? []).map(({ x, y }) => `${x},${y}`).join(" ");
    for (const line of this.ink.children) line.setAttribute("points", points);
  }

  // Evenly spaced: { x, y, face, point }, with face -1 where the line lies beside the scan.
  sampled(line) {
    const { viewer } = this;
    const { left, top } = viewer.canvas.getBoundingClientRect();
    const box = viewer.paneBoxes().find((b) => b.name === "result");
    const at = [0];
    for (let k = 1; k < line.length; k++) at.push(at[k - 1] + Math.hypot(line[k].x - line[k - 1].x, line[k].y - line[k - 1].y));
    const count = Math.min(SAMPLES_MAX, Math.max(2, Math.round(at.at(-1) / SAMPLE_PX)));
    const samples = [];
    for (let s = 0, k = 1; s <= count; s++) {
      const far = (s / count) * at.at(-1);
      while (k < at.length - 1 && at[k] < far) k++;
      const t = at[k] > at[k - 1] ? (far - at[k - 1]) / (at[k] - at[k - 1]) : 0;
      const [x, y] = [line[k - 1].x + t * (line[k].x - line[k - 1].x), line[k - 1].y + t * (line[k].y - line[k - 1].y)];
      const found = viewer.under({ clientX: left + x, clientY: top + y }, box);
      samples.push({ x, y, face: found?.face ?? -1, point: found?.point });
    }
    return samples;
  }
}
