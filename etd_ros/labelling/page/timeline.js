// A row for each target: where it has boxes, and its key frames.

import { colourOf } from "./view.js";

const ROW_CSS_PX = 14;
const END_CSS_PX = 8; // where a slider's knob stands at its ends, so that both agree

export class Timeline {
  constructor(canvas, count, sought) {
    Object.assign(this, { canvas, count, sought });
    const seek = (event) => {
      const area = canvas.getBoundingClientRect();
      const share = (event.clientX - area.left - END_CSS_PX) / Math.max(1, area.width - 2 * END_CSS_PX);
      sought(Math.round(Math.min(1, Math.max(0, share)) * (count - 1)));
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      seek(event);
    });
    canvas.addEventListener("pointermove", (event) => event.buttons && seek(event));
  }

  column(at) {
    return END_CSS_PX + (at / Math.max(1, this.count - 1)) * (this.canvas.width - 2 * END_CSS_PX);
  }

  draw(targets, active, current) {
    const height = Math.max(1, targets.length) * ROW_CSS_PX + 2;
    this.canvas.style.height = `${height}px`;
    this.canvas.width = this.canvas.clientWidth;
    this.canvas.height = height;
    const context = this.canvas.getContext("2d");
    targets.forEach((target, index) => {
      const top = index * ROW_CSS_PX + 1;
      context.fillStyle = target.name === active ? "#33373b" : "#26292c";
      context.fillRect(0, top, this.canvas.width, ROW_CSS_PX - 2);
      context.fillStyle = context.strokeStyle = colourOf(index);
      this.drawBars(context, target.boxes, top);
      for (const key of target.keys) this.drawKey(context, this.column(key.at), top + ROW_CSS_PX / 2 - 1, key.box);
    });
    context.fillStyle = "#fff";
    context.fillRect(Math.round(this.column(current)), 0, 1, height);
  }

  drawBars(context, boxes, top) {
    context.globalAlpha = 0.45;
    let first = null;
    for (let index = 0; index <= boxes.length; index += 1) {
      if (boxes[index] && first === null) first = index;
      if (!boxes[index] && first !== null) {
        context.fillRect(this.column(first), top + 4, Math.max(1, this.column(index - 1) - this.column(first)), 4);
        first = null;
      }
    }
    context.globalAlpha = 1;
  }

  drawKey(context, column, row, box) {
    context.beginPath();
    context.arc(column, row, 3.5, 0, 2 * Math.PI);
    if (box) context.fill();
    else context.stroke();
  }
}
