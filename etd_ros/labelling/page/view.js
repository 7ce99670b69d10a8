// The picture with its boxes, and the drags that change them. Boxes are [x, y, w, h] in pixels of the picture.

export const COLOURS = [
  "#ffd23f", "#3fc1ff", "#ff6f91", "#7be07b", "#c79bff", "#ff9f45", "#4fe0cf", "#f58ee6", "#b8d13c", "#9fb4ff",
];
const HANDLE_CSS_PX = 7;
const EDGE_HANDLES_FROM_CSS_PX = 36;
const ZOOMS = [0.25, 0.5, 0.75, 1, 2, 3, 4, 5, 6, 8, 10, 12, 16];
const CURSORS = { nw: "nwse-resize", se: "nwse-resize", ne: "nesw-resize", sw: "nesw-resize", n: "ns-resize", s: "ns-resize", w: "ew-resize", e: "ew-resize" };

export function colourOf(index) {
  return COLOURS[index % COLOURS.length];
}

export class View {
  // `shown()` gives {image, boxes: [{name, colour, box, look}], active} with looks key, between and ghost; `drawn(name,
  // box)` is called with a finished box, and `chosen(name)` with a target that is clicked.
  constructor(canvas, stage, width, height, { shown, drawn, chosen }) {
    Object.assign(this, { canvas, stage, width, height, shown, drawn, chosen, zoom: 1, isFitted: true, drag: null, sent: null, brightness: 1 });
    canvas.addEventListener("pointerdown", (event) => this.begin(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.end(event));
    canvas.addEventListener("pointercancel", () => this.cancel());
    new ResizeObserver(() => this.isFitted && this.fit()).observe(stage);
    this.fit();
  }

  fit() {
    const room = Math.min(this.stage.clientWidth / this.width, this.stage.clientHeight / this.height);
    this.setZoom(ZOOMS.findLast((zoom) => zoom <= room) ?? ZOOMS[0]);
    this.isFitted = true;
  }

  zoomBy(steps) {
    const index = ZOOMS.indexOf(this.zoom) + steps;
    if (ZOOMS[index]) this.setZoom(ZOOMS[index]);
  }

  // What is looked at stays in the middle: the active target's box, or else the picture's own middle.
  setZoom(zoom) {
    this.isFitted = false;
    this.zoom = zoom;
    this.canvas.width = this.width * zoom;
    this.canvas.height = this.height * zoom;
    this.draw();
    const [x, y, w, h] = this.shown().boxes.find((item) => item.isActive)?.box ?? [0, 0, this.width, this.height];
    this.stage.scrollTo((x + w / 2) * this.zoom - this.stage.clientWidth / 2, (y + h / 2) * this.zoom - this.stage.clientHeight / 2);
  }

  draw() {
    const context = this.canvas.getContext("2d");
    const { image, boxes } = this.shown();
    context.imageSmoothingEnabled = this.zoom < 1;
    context.fillStyle = "#000";
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    if (image) {
      context.filter = this.brightness === 1 ? "none" : `brightness(${this.brightness})`;
      context.drawImage(image, 0, 0, this.canvas.width, this.canvas.height);
      context.filter = "none";
    }
    const changed = [this.sent, this.drag].filter((drag) => drag?.box);
    const isChanged = (item) => changed.some((drag) => drag.name === item.name);
    for (const item of boxes.filter((item) => !isChanged(item))) this.drawBox(context, item);
    for (const drag of changed) this.drawBox(context, { ...drag, look: "key", caption: `${drag.name}  ${drag.box.map(Math.round).join(" ")}` });
  }

  drawBox(context, { name, caption = name, colour, box, look, isActive }) {
    const [x, y, w, h] = box.map((value) => value * this.zoom);
    context.save();
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = isActive && look !== "ghost" ? 2 : 1;
    context.globalAlpha = look === "ghost" ? 0.6 : 1;
    context.setLineDash({ key: [], between: [6, 4], ghost: [2, 4] }[look]);
    context.strokeRect(x, y, w, h);
    context.setLineDash([]);
    if (isActive) {
      for (const [, column, row] of this.handles(box)) {
        context.fillRect(column * this.zoom - 3, row * this.zoom - 3, 6, 6);
      }
    }
    if (look !== "ghost") {
      context.font = "12px system-ui, sans-serif";
      const isRoomAbove = y >= 16;
      const wide = context.measureText(caption).width + 6;
      const left = Math.min(Math.max(0, x - 1), Math.max(0, this.canvas.width - wide));
      const top = isRoomAbove ? y - 16 : Math.min(y + h + 1, this.canvas.height - 15);
      context.fillRect(left, top, wide, 15);
      context.fillStyle = "#111";
      context.fillText(caption, left + 3, top + 12);
    }
    context.restore();
  }

  // [direction, column, row] of the points by which a box is resized; those of the edges only where there is room.
  handles([x, y, w, h]) {
    const points = [["nw", x, y], ["ne", x + w, y], ["sw", x, y + h], ["se", x + w, y + h]];
    if (w * this.zoom >= EDGE_HANDLES_FROM_CSS_PX) points.push(["n", x + w / 2, y], ["s", x + w / 2, y + h]);
    if (h * this.zoom >= EDGE_HANDLES_FROM_CSS_PX) points.push(["w", x, y + h / 2], ["e", x + w, y + h / 2]);
    return points;
  }

  // Where the pointer is, in pixels of the picture: 0 is the left edge of the first column.
  pointOf(event) {
    const area = this.canvas.getBoundingClientRect();
    return [
      ((event.clientX - area.left) * this.width) / area.width,
      ((event.clientY - area.top) * this.height) / area.height,
    ];
  }

  // What a press here would take hold of: {item, handle}, handle "" for the whole box; null draws a new one.
  grabbed([x, y], isNew) {
    if (isNew) return null;
    const { boxes } = this.shown();
    const reach = HANDLE_CSS_PX / this.zoom;
    const active = boxes.find((item) => item.isActive);
    if (active) {
      const handle = this.handles(active.box).find(([, column, row]) => Math.hypot(column - x, row - y) <= reach);
      if (handle) return { item: active, handle: handle[0] };
    }
    const inside = boxes.filter(({ box: [left, top, w, h] }) => x >= left && y >= top && x <= left + w && y <= top + h);
    inside.sort((one, two) => two.isActive - one.isActive || one.box[2] * one.box[3] - two.box[2] * two.box[3]);
    return inside.length ? { item: inside[0], handle: "" } : null;
  }

  begin(event) {
    if (event.button !== 0) return;
    const start = this.pointOf(event);
    const grabbed = this.grabbed(start, event.shiftKey);
    const { active } = this.shown();
    const target = grabbed ? grabbed.item : active;
    this.drag = { name: target.name, colour: target.colour, isActive: true, start, grabbed, box: null };
    this.canvas.setPointerCapture(event.pointerId);
  }

  move(event) {
    const point = this.pointOf(event);
    if (!this.drag) {
      const grabbed = this.grabbed(point, event.shiftKey);
      this.canvas.style.cursor = grabbed ? CURSORS[grabbed.handle] ?? "move" : "crosshair";
      return;
    }
    this.drag.box = this.draggedBox(point);
    this.draw();
  }

  draggedBox(point) {
    const { start, grabbed } = this.drag;
    const column = (value) => Math.min(this.width, Math.max(0, Math.round(value)));
    const row = (value) => Math.min(this.height, Math.max(0, Math.round(value)));
    if (!grabbed) {
      const [left, right] = [column(start[0]), column(point[0])].sort((one, two) => one - two);
      const [top, bottom] = [row(start[1]), row(point[1])].sort((one, two) => one - two);
      return right > left && bottom > top ? [left, top, right - left, bottom - top] : null;
    }
    const [x, y, w, h] = grabbed.item.box;
    const [dx, dy] = [point[0] - start[0], point[1] - start[1]];
    if (!grabbed.handle) {
      if (Math.hypot(dx, dy) * this.zoom < 3) return null;
      return [this.within(Math.round(x + dx), w, this.width), this.within(Math.round(y + dy), h, this.height), w, h];
    }
    let [left, top, right, bottom] = [x, y, x + w, y + h];
    if (grabbed.handle.includes("w")) left = Math.min(column(left + dx), right - 1);
    if (grabbed.handle.includes("e")) right = Math.max(column(right + dx), left + 1);
    if (grabbed.handle.includes("n")) top = Math.min(row(top + dy), bottom - 1);
    if (grabbed.handle.includes("s")) bottom = Math.max(row(bottom + dy), top + 1);
    return [left, top, right - left, bottom - top];
  }

  within(start, length, room) {
    return Math.min(Math.max(0, start), Math.max(0, room - length));
  }

  end(event) {
    if (!this.drag) return;
    const { name, grabbed } = this.drag;
    const box = this.draggedBox(this.pointOf(event));
    // What was drawn stays on the screen until the answer has come, so that the box does not jump back.
    this.sent = box ? { ...this.drag, box } : null;
    this.drag = null;
    if (grabbed) this.chosen(name);
    if (box) this.drawn(name, box);
    this.draw();
  }

  cancel() {
    this.drag = null;
    this.draw();
  }

  answered() {
    this.sent = null;
    this.draw();
  }
}
