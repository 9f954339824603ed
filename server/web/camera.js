// Turning, shifting and coming nearer: by mouse, wheel, touch and keys. One camera for all panes, so that they move as one.

const STEP = 0.15;
const ZOOM = [0.2, 60];

export const times = (a, b) => a.map((_, k) => [0, 1, 2].reduce((sum, j) => sum + a[3 * j + (k % 3)] * b[3 * Math.floor(k / 3) + j], 0));

// Columns of Rx·Ry.
export function about(x, y) {
  const [cx, sx, cy, sy] = [Math.cos(x), Math.sin(x), Math.cos(y), Math.sin(y)];
  return [cy, sx * sy, -cx * sy, 0, cx, sx, sy, -sx * cy, cx * cy];
}

// Views by name; the first is where one begins.
export const VIEWS = { Home: [0.2, -0.5], 1: [0, 0], 3: [0, -Math.PI / 2], 7: [Math.PI / 2, 0] };

export class Camera {
  // `hooks`: `onchange()`; `ongrasp(event)` tells whether the pointer takes hold of something; then `onhold(event)` and
  // `onlet(event)`; `onpoint(event)` for a click that turned nothing; `onhover(event)`; `unit(event)`: what a pixel is.
  constructor(canvas, hooks) {
    Object.assign(this, { canvas, hooks, turn: about(...VIEWS.Home), pan: [0, 0], zoom: 1, pointers: new Map(), holds: false });
    this.listen();
  }

  changed() { this.hooks.onchange(); }

  turnBy(x, y) { this.turn = times(about(x, y), this.turn); this.changed(); }

  panBy(dx, dy) {
    const unit = this.hooks.unit();
    this.pan = [this.pan[0] + dx * unit, this.pan[1] - dy * unit];
    this.changed();
  }

  // `about`: the point of the picture that stays where it is.
  zoomBy(factor, [x, y] = [0, 0]) {
    const zoom = Math.min(ZOOM[1], Math.max(ZOOM[0], this.zoom * factor));
    const by = zoom / this.zoom;
    this.zoom = zoom;
    this.pan = [x - (x - this.pan[0]) * by, y - (y - this.pan[1]) * by];
    this.changed();
  }

  view(name) {
    [this.turn, this.pan, this.zoom] = [about(...VIEWS[name]), [0, 0], 1];
    this.changed();
  }

  listen() {
    const { canvas, hooks } = this;
    const on = (name, act, options) => canvas.addEventListener(name, act, options);
    on("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY, moved: 0 });
      if (this.pointers.size === 1) this.holds = event.button === 0 && !event.shiftKey && hooks.ongrasp(event);
      // A second finger means pinching, whatever the first held.
      else if (this.holds) { this.holds = false; hooks.onlet(null); }
    });
    on("pointermove", (event) => {
      const last = this.pointers.get(event.pointerId);
      if (!last) { hooks.onhover(event); return; }
      const [dx, dy] = [event.clientX - last.x, event.clientY - last.y];
      const other = [...this.pointers.entries()].find(([id]) => id !== event.pointerId)?.[1];
      last.moved += Math.abs(dx) + Math.abs(dy);
      if (other) {
        const [before, after] = [last, { x: event.clientX, y: event.clientY }].map((p) => Math.hypot(p.x - other.x, p.y - other.y));
        this.panBy(dx / 2, dy / 2);
        if (before > 0) this.zoomBy(after / before, hooks.place({ clientX: (event.clientX + other.x) / 2, clientY: (event.clientY + other.y) / 2 }));
      } else if (this.holds) hooks.onhold(event);
      else if (event.shiftKey || event.buttons & 6) this.panBy(dx, dy);
      else this.turnBy(dy / 150, dx / 150);
      [last.x, last.y] = [event.clientX, event.clientY];
    });
    const up = (event) => {
      const last = this.pointers.get(event.pointerId);
      this.pointers.delete(event.pointerId);
      if (this.holds) { this.holds = false; hooks.onlet(event); } else if (last && last.moved < 5 && event.button === 0 && this.pointers.size === 0) hooks.onpoint(event);
    };
    on("pointerup", up);
    on("pointercancel", (event) => { this.pointers.delete(event.pointerId); if (this.holds) { this.holds = false; hooks.onlet(null); } });
    on("contextmenu", (event) => event.preventDefault());
    on("wheel", (event) => {
      event.preventDefault();
      // A wheel that counts lines, not pixels.
      const by = event.deltaY * (event.deltaMode === 1 ? 33 : 1);
      this.zoomBy(Math.exp(-by / (event.ctrlKey ? 120 : 500)), hooks.place(event));
    }, { passive: false });
    on("keydown", (event) => this.key(event));
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const turns = { ArrowLeft: [0, -STEP], ArrowRight: [0, STEP], ArrowUp: [-STEP, 0], ArrowDown: [STEP, 0] };
    if (turns[event.key] && event.shiftKey) this.panBy(turns[event.key][1] * 120, turns[event.key][0] * 120);
    else if (turns[event.key]) this.turnBy(...turns[event.key]);
    else if (event.key === "+" || event.key === "=") this.zoomBy(1.15);
    else if (event.key === "-") this.zoomBy(1 / 1.15);
    else if (VIEWS[event.key]) this.view(event.key);
    else return;
    event.preventDefault();
  }
}
