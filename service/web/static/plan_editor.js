// What is planned of the next hours, heating or set-points, as bars: dragged with the pointer, moved with the arrow keys.

import { element, set, svg } from "./dom.js";
import { amount, t } from "./text.js";
import { clock, moment } from "./time.js";

const HEIGHT = 120;
const STEPS = 20;

// The editor of `channel` (with `unit`), whose `slots` begin at `times` (ms); `now` is its value now, `usual` its mean of late, `most` the largest.
// Set-points go up from `least` by `grain`. `changed(values)` is called with the values of all slots, null for as it is now. `move` takes it on to later slots.
export function planEditor({ channel, unit, times, now, usual, most, least = 0, grain = null, changed }) {
  let largest = grain === null ? roundUp(most) : most;
  const stepOf = () => grain ?? largest / STEPS;
  let values = times.map(() => now);
  let touched = false;
  let bars = [];
  const area = svg("svg", { class: "plan", preserveAspectRatio: "none", role: "group", "aria-label": t("plan.label", { channel }) });
  const marks = element("div", { className: "plan-axis muted", "aria-hidden": "true" });

  function lay() {
    area.setAttribute("viewBox", `0 0 ${times.length * 10} ${HEIGHT}`);
    bars = times.map((time, index) => {
      const track = svg("rect", { x: index * 10, y: 0, width: 10, height: HEIGHT, class: "track" });
      const bar = svg("rect", { x: index * 10 + 0.6, width: 8.8, class: "bar" });
      const handle = svg("g", { tabindex: "0", role: "slider", "aria-label": t("plan.slot", { time: moment(time) }), "aria-valuemin": String(least) }, track, bar);
      handle.addEventListener("keydown", (event) => pressed(event, index));
      return { handle, bar };
    });
    area.replaceChildren(...bars.map(({ handle }) => handle));
    mark(marks, times);
  }
  function move(later, latest) {
    if (later.length === times.length && later.every((time, index) => time === times[index])) return;
    const held = later.map((time) => times.findLastIndex((one) => one <= time));
    const focused = times[bars.findIndex(({ handle }) => handle === document.activeElement)];
    values = touched ? held.map((at) => values[Math.max(0, at)]) : later.map(() => latest);
    now = latest;
    times = later;
    last = null;
    lay();
    draw();
    // Whoever is at a bar stays at that time, or at the next one if it has passed.
    if (focused !== undefined) bars[Math.max(0, times.findIndex((time) => time >= focused))].handle.focus({ preventScroll: true });
  }

  function draw() {
    area.classList.toggle("unplanned", !touched);
    bars.forEach(({ handle, bar }, index) => {
      const height = Math.max(1.5, ((Math.min(values[index], largest) - least) / (largest - least)) * HEIGHT);
      bar.setAttribute("y", (HEIGHT - height).toFixed(2));
      bar.setAttribute("height", height.toFixed(2));
      set(handle, { "aria-valuemax": String(largest), "aria-valuenow": String(grain === null ? Math.round(values[index]) : values[index]), "aria-valuetext": `${amount(values[index])} ${unit}` });
    });
    scale.textContent = `${amount(largest)} ${unit}`;
  }
  function put(index, value) {
    const next = Math.max(least, Math.min(largest, value));
    if (values[index] === next && touched) return;
    values[index] = next;
    tell();
  }
  function tell() {
    touched = true;
    draw();
    changed([...values]);
  }
  function pressed(event, index) {
    const step = stepOf();
    const move = { ArrowUp: step, ArrowDown: -step, PageUp: 5 * step, PageDown: -5 * step, Home: -Infinity, End: Infinity }[event.key];
    if (move !== undefined) {
      event.preventDefault();
      put(index, Number.isFinite(move) ? values[index] + move : move > 0 ? largest : least);
    } else if (event.key === "ArrowRight" || event.key === "ArrowLeft") {
      event.preventDefault();
      bars[index + (event.key === "ArrowRight" ? 1 : -1)]?.handle.focus();
    }
  }
  let last = null;
  function drag(event) {
    const box = area.getBoundingClientRect();
    const index = Math.max(0, Math.min(times.length - 1, Math.floor(((event.clientX - box.left) / box.width) * times.length)));
    const step = stepOf();
    const value = Math.round((least + (1 - (event.clientY - box.top) / box.height) * (largest - least)) / step) * step;
    // A quick stroke skips bars; those between follow.
    const from = last ?? index;
    for (let each = Math.min(from, index); each <= Math.max(from, index); each += 1) put(each, value);
    last = index;
  }
  area.addEventListener("pointerdown", (event) => {
    area.setPointerCapture(event.pointerId);
    event.preventDefault();
    last = null;
    drag(event);
  });
  area.addEventListener("pointermove", (event) => {
    if (area.hasPointerCapture(event.pointerId)) drag(event);
  });

  const scale = element("span", { className: "muted plan-scale" });
  const until = element("input", { type: "time", value: "06:00", step: 3600, "aria-label": t("plan.until") });
  const ceiling = element("input", { type: "number", min: "1", step: "any", value: String(largest), "aria-label": t("plan.most", { unit }) });
  ceiling.addEventListener("change", () => {
    const value = Number(ceiling.value);
    if (value > least) {
      largest = value;
      values = values.map((each) => Math.min(each, largest));
      if (touched) tell();
      else draw();
    }
  });
  const button = (text, act) => {
    const node = element("button", { type: "button", textContent: text });
    node.addEventListener("click", act);
    return node;
  };
  const then = element("p", { className: "muted plan-then", role: "status" });
  const tools = element(
    "div",
    { className: "controls" },
    button(t("plan.now"), () => {
      values = times.map(() => now);
      touched = false;
      then.textContent = "";
      draw();
      changed(null);
    }),
    ...(grain === null ? switches() : []),
    element("label", { className: "nowrap" }, `${t("plan.most", { unit })} `, ceiling),
  );
  function switches() {
    const off = button(t("plan.off"), () => {
      values = times.map(() => 0);
      then.textContent = "";
      tell();
    });
    return [off, element("span", { className: "nowrap" }, button(t("plan.off_until"), () => offUntil()), " ", until)];
  }
  function offUntil() {
    // The first hour of the site's day with this name that lies ahead.
    const hour = (until.value || "00:00").slice(0, 2);
    const after = times.findIndex((time, index) => clock(time).slice(0, 2) === hour && (index > 0 || clock(time).endsWith(":00")));
    const begins = after < 0 ? times.length : after;
    // Heating that is switched is often off just now; then what it took of late is the better guess.
    const later = Math.min(largest, now > 0 ? now : usual > 0 ? usual : largest / 2);
    if (begins < times.length) then.textContent = t("plan.then", { time: clock(times[begins]), value: `${amount(later, 2)} ${unit}` });
    values = times.map((_, index) => (index < begins ? 0 : later));
    tell();
  }
  const node = element("div", { className: "plan-box" }, element("div", { className: "plan-head" }, element("h3", { textContent: t("plan.title", { channel }) }), scale), area, marks, tools, then);
  lay();
  draw();
  return {
    node,
    move,
    get planned() {
      return touched ? [...values] : null;
    },
  };
}

function mark(place, times) {
  const every = Math.max(1, Math.round(times.length / 6));
  const shown = times.map((time, index) => [time, index]).filter(([, index]) => index % every === 0 && index <= times.length - every / 2);
  place.replaceChildren(
    ...shown.map(([time, index]) => {
      const node = element("span", { textContent: clock(time) });
      node.style.left = `${(100 * index) / times.length}%`;
      return node;
    }),
  );
}

function roundUp(value) {
  const most = Math.max(value, 100);
  const unit = 10 ** Math.floor(Math.log10(most));
  return [1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10].map((each) => each * unit).find((each) => each >= most);
}
