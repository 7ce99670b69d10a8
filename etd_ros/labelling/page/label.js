// The page: it shows the labels that the server holds, and sends it each change.

import { Timeline } from "./timeline.js";
import { View, colourOf } from "./view.js";

const KEPT_IMAGES = 300;
const AHEAD = 12;

const element = (id) => document.getElementById(id);
const sequence = await (await fetch("sequence")).json();
const count = sequence.times_s.length;
const images = new Map();
let labels = { targets: [], is_saved: true, can_undo: false, can_redo: false };
let active = null; // name of the target that is worked on
let current = 0; // number of the picture
let playing = null;
let waiting = Promise.resolve();
let unanswered = 0; // changes sent
let latest = null; // the server's last state

// --- the server -----------------------------------------------------------------------------------------------------

function say(text, isError = false) {
  element("message").textContent = text;
  element("message").className = isError ? "error" : "";
}

// Changes are sent one after another, in the order in which they were made. What they lead to is shown when all have
// been answered: an answer in between would take back what was done since.
function send(path, content) {
  unanswered += 1;
  waiting = waiting.then(async () => {
    try {
      const answer = await fetch(path, {
        method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content),
      });
      const result = await answer.json();
      say(result.error ?? result.notice ?? "", Boolean(result.error));
      if (!result.error) latest = result;
    } catch (error) {
      say("The program has ended. What was drawn before is kept: run the same `label` command to go on.", true);
    }
    unanswered -= 1;
    if (unanswered === 0) {
      view.answered();
      show(latest);
    }
  });
  return waiting;
}

const edit = (action, content = {}) => send("edit", { action, ...content });

function show(state) {
  latest = state;
  labels = structuredClone(state);
  if (!labels.targets.some((target) => target.name === active)) active = labels.targets[0]?.name ?? null;
  drawAll();
}

// --- pictures -------------------------------------------------------------------------------------------------------

function imageOf(index) {
  let image = images.get(index);
  if (image) images.delete(index);
  else {
    image = new Image();
    image.onload = () => index === current && view.draw();
    image.src = `pictures/${index}`;
  }
  images.set(index, image);
  while (images.size > KEPT_IMAGES) images.delete(images.keys().next().value);
  return image;
}

const isReady = (image) => image.complete && image.naturalWidth > 0;

function go(index) {
  current = Math.min(count - 1, Math.max(0, index));
  for (let next = current + 1; next < Math.min(count, current + AHEAD); next += 1) imageOf(next);
  imageOf(current);
  drawAll();
}

function play() {
  if (playing) {
    cancelAnimationFrame(playing.request);
    playing = null;
  } else {
    if (current === count - 1) go(0);
    playing = { from: sequence.times_s[current], since: performance.now(), request: requestAnimationFrame(step) };
  }
  element("play").textContent = playing ? "Pause" : "Play";
}

function step(now) {
  if (!playing) return;
  const time = playing.from + ((now - playing.since) / 1000) * Number(element("speed").value);
  let next = current;
  while (next + 1 < count && sequence.times_s[next + 1] <= time) next += 1;
  if (next !== current && isReady(imageOf(next))) go(next);
  if (current === count - 1) play();
  else playing.request = requestAnimationFrame(step);
}

// --- what is shown --------------------------------------------------------------------------------------------------

const targetOf = (name) => labels.targets.find((target) => target.name === name);
// Labels made elsewhere may have key frames between the pictures: the nearest one counts where none is on the picture.
function keyIndex(target) {
  const keys = target?.keys ?? [];
  const exact = keys.findIndex((key) => key.at === current);
  return exact >= 0 ? exact : keys.findIndex((key) => Math.round(key.at) === current);
}

// Of a target without a box here, the box of its last key frame, or else of its next: to be taken on from there.
function ghostOf(target) {
  const withBox = target.keys.filter((key) => key.box);
  return (withBox.findLast((key) => key.at <= current) ?? withBox[0])?.box ?? null;
}

function shownBoxes() {
  return labels.targets.flatMap((target, index) => {
    const isActive = target.name === active;
    const own = target.boxes[current];
    const isHidden = keyIndex(target) >= 0 && !target.keys[keyIndex(target)].box;
    const ghost = isActive && !own && !playing ? ghostOf(target) : null;
    if (!own && !ghost) return [];
    const look = own ? (keyIndex(target) >= 0 && !isHidden ? "key" : "between") : "ghost";
    return [{ name: target.name, colour: colourOf(index), box: own ?? ghost, look, isActive: isActive && !playing }];
  });
}

function newName() {
  let number = labels.targets.length + 1;
  while (targetOf(`target_${number}`)) number += 1;
  return `target_${number}`;
}

// The target that a new box is drawn for; it may be one whose making has not been answered yet.
function activeTarget() {
  const index = labels.targets.findIndex((target) => target.name === active);
  return { name: active ?? newName(), colour: colourOf(index < 0 ? labels.targets.length : index) };
}

function drawAll() {
  view.draw();
  timeline.draw(labels.targets, active, current);
  element("slider").value = current;
  element("time").textContent = `${current + 1} / ${count} · ${sequence.times_s[current].toFixed(3)} s`;
  element("zoom").textContent = `${view.zoom} ×`;
  element("undo").disabled = !labels.can_undo;
  element("redo").disabled = !labels.can_redo;
  element("save").className = labels.is_saved ? "" : "unsaved";
  element("save").textContent = labels.is_saved ? "Saved" : "Save";
  drawTargets();
  drawHere();
}

function drawTargets() {
  const list = element("targets");
  // Names being typed must not be taken away.
  if (list.contains(document.activeElement) && document.activeElement.tagName === "INPUT") {
    [...list.children].forEach((row) => row.classList.toggle("active", row.dataset.name === active));
    return;
  }
  list.replaceChildren(...labels.targets.map(targetRow));
}

function targetRow(target, index) {
  const row = document.createElement("li");
  row.dataset.name = target.name;
  row.className = target.name === active ? "active" : "";
  const swatch = document.createElement("span");
  swatch.className = "swatch";
  swatch.style.background = colourOf(index);
  const name = document.createElement("input");
  name.value = target.name;
  name.maxLength = 64;
  name.title = "click to rename";
  name.addEventListener("focus", () => choose(target.name));
  name.addEventListener("blur", () => rename(target.name, name.value));
  const kind = document.createElement("input");
  kind.className = "class";
  kind.value = target.class;
  kind.maxLength = 64;
  kind.placeholder = "class";
  kind.title = "what it is, as in person (may be empty)";
  kind.addEventListener("focus", () => choose(target.name));
  kind.addEventListener("blur", () => classify(target, kind.value));
  const number = document.createElement("span");
  number.className = "count";
  number.textContent = `${target.keys.length} key${target.keys.length === 1 ? "" : "s"}`;
  const remove = document.createElement("button");
  remove.textContent = "×";
  remove.title = `delete ${target.name} (can be undone)`;
  remove.addEventListener("click", () => edit("delete", { target: target.name }));
  row.append(swatch, name, kind, number, remove);
  row.addEventListener("click", (event) => event.target !== remove && choose(target.name));
  return row;
}

function drawHere() {
  const target = targetOf(active);
  const key = keyIndex(target);
  const box = target?.boxes[current];
  let text = "Draw a box to begin.";
  if (target) {
    text = box ? `${active}: x ${round(box[0])}, y ${round(box[1])}, w ${round(box[2])}, h ${round(box[3])}` : `${active}: no label${ghostOf(target) ? " (drag the dotted box to go on from it)" : ""}`;
    if (key >= 0) text += target.keys[key].box ? " (key frame)" : " (key frame: not visible)";
    else if (box) text += " (interpolated)";
  }
  element("here").textContent = text;
  element("key").disabled = !target || (!box && !ghostOf(target)) || (key >= 0 && Boolean(box));
  element("hide").disabled = !target;
  element("clear").disabled = key < 0;
}

const round = (value) => Math.round(value * 10) / 10;

// --- what is done ---------------------------------------------------------------------------------------------------

function choose(name) {
  active = name;
  drawAll();
}

function rename(name, wanted) {
  const to = wanted.trim();
  if (to && to !== name) {
    if (active === name && !targetOf(to)) active = to;
    edit("rename", { target: name, to }).then(drawAll);
  } else setTimeout(drawAll);
}

function classify(target, wanted) {
  const to = wanted.trim();
  if (to !== target.class) edit("class", { target: target.name, to }).then(drawAll);
  else setTimeout(drawAll);
}

function drawn(name, box) {
  active = name;
  // The next change may build upon this one before the answer is there.
  const target = targetOf(name);
  if (target) target.boxes[current] = box;
  edit("box", { target: name, picture: current, box });
  drawAll();
}

function makeKey() {
  const target = targetOf(active);
  const box = target && (target.boxes[current] ?? ghostOf(target));
  if (box) drawn(active, box);
}

function nudge(dx, dy) {
  const target = targetOf(active);
  const box = target && (target.boxes[current] ?? ghostOf(target));
  if (box) drawn(active, [view.within(box[0] + dx, box[2], view.width), view.within(box[1] + dy, box[3], view.height), box[2], box[3]]);
}

function clearKey() {
  const key = keyIndex(targetOf(active));
  if (key >= 0) edit("clear", { target: active, key });
}

function goToKey(direction) {
  const places = (targetOf(active)?.keys ?? []).map((key) => Math.round(key.at));
  const next = direction > 0 ? places.find((at) => at > current) : places.findLast((at) => at < current);
  if (next !== undefined) go(next);
}

const hideTarget = () => active && edit("hide", { target: active, picture: current });

function zoomBy(steps) {
  view.zoomBy(steps);
  drawAll();
}

function fit() {
  view.fit();
  drawAll();
}

const KEYS = {
  " ": play, h: hideTarget, Delete: clearKey, Backspace: clearKey, Enter: makeKey, ",": () => goToKey(-1), ".": () => goToKey(1),
  Home: () => go(0), End: () => go(count - 1), "+": () => zoomBy(1), "=": () => zoomBy(1), "-": () => zoomBy(-1), 0: fit,
  n: () => element("name").focus(), Escape: () => view.cancel(),
};
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

function pressed(event) {
  const isTyping = event.target.matches("input:not([type=range])");
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (event.ctrlKey || event.metaKey) {
    if (key === "s") send("save", {});
    else if (isTyping) return;
    else if (key === "z") edit(event.shiftKey ? "redo" : "undo");
    else if (key === "y") edit("redo");
    else return;
  } else if (isTyping) {
    if (key === "Enter" && event.target.id !== "name") event.target.blur();
    else if (key === "Escape") event.target.blur();
    return;
  } else if (ARROWS[key] && event.altKey) nudge(...ARROWS[key]);
  else if (ARROWS[key]) go(current + (ARROWS[key][0] || ARROWS[key][1]) * (event.shiftKey ? 10 : 1));
  else if (event.altKey) return;
  else if (/^[1-9]$/.test(key) && labels.targets[key - 1]) choose(labels.targets[key - 1].name);
  else if (KEYS[key] && !(event.target.matches("button, select") && (key === " " || key === "Enter"))) KEYS[key]();
  else return;
  event.preventDefault();
}

// --- the beginning --------------------------------------------------------------------------------------------------

const view = new View(element("picture"), element("stage"), sequence.width, sequence.height, {
  shown: () => ({ image: isReady(imageOf(current)) ? imageOf(current) : null, boxes: shownBoxes(), active: activeTarget() }),
  drawn,
  chosen: choose,
});
const timeline = new Timeline(element("timeline"), count, go);

document.title = `label ${sequence.title}`;
element("title").textContent = `${sequence.title} (${sequence.kind})`;
element("slider").max = count - 1;
element("slider").addEventListener("input", () => go(Number(element("slider").value)));
element("brightness").addEventListener("change", () => {
  view.brightness = Number(element("brightness").value);
  view.draw();
});
element("add").addEventListener("submit", (event) => {
  event.preventDefault();
  const name = element("name").value.trim();
  element("name").value = "";
  element("name").blur();
  if (!name) return;
  active = name;
  edit("add", { target: name }).then(() => choose(name));
});
for (const [id, action] of Object.entries({
  back: () => go(current - 1), play, forward: () => go(current + 1), smaller: () => zoomBy(-1), larger: () => zoomBy(1), fit,
  key: makeKey, hide: hideTarget, clear: clearKey, undo: () => edit("undo"), redo: () => edit("redo"), save: () => send("save", {}),
})) {
  element(id).addEventListener("click", () => {
    action();
    // A button that keeps the focus would take the next space for itself.
    element(id).blur();
  });
}
addEventListener("keydown", pressed);
addEventListener("resize", drawAll);

show(await (await fetch("labels")).json());
say(labels.is_saved ? "" : "Work that was not saved goes on.");
go(0);
