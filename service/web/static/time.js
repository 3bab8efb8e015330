// Times of the site on the page, UTC on hover. Inside, times are ms since 1970.

import { element } from "./dom.js";
import { language } from "./text.js";

const DAY = 86_400_000;

let zone = Intl.DateTimeFormat().resolvedOptions().timeZone;
let sited = false;

export function useTimeZone(name) {
  if (!name) return;
  zone = name;
  sited = true;
}

export function timeZone() {
  return zone;
}

const formats = new Map();

function format(style, time) {
  const key = `${language} ${style} ${zone}`;
  if (!formats.has(key)) {
    const options = {
      clock: { hour: "2-digit", minute: "2-digit" },
      day: { weekday: "short", day: "numeric", month: "short" },
      moment: { weekday: "short", day: "numeric", month: "short", hour: "2-digit", minute: "2-digit" },
    }[style];
    formats.set(key, new Intl.DateTimeFormat(language, { ...options, hourCycle: "h23", timeZone: zone }));
  }
  return formats.get(key).format(time);
}

export const clock = (time) => format("clock", time);
export const day = (time) => format("day", time);
export const moment = (time) => format("moment", time);

export function utcText(time) {
  return `${new Date(time).toISOString().slice(0, 16).replace("T", " ")} UTC`;
}

// `time` for the page: the site's clock, UTC on hover; the day too if that is not the day of `now`.
export function timeNode(time, now = Date.now()) {
  const text = day(time) === day(now) ? clock(time) : moment(time);
  return element("time", { textContent: text, title: utcText(time), datetime: new Date(time).toISOString() });
}

// How far the site's clock is ahead of UTC at `time`, in ms.
export function offset(time) {
  const parts = Object.fromEntries(
    new Intl.DateTimeFormat("en-GB", {
      timeZone: zone, hourCycle: "h23", year: "numeric", month: "2-digit", day: "2-digit", hour: "2-digit", minute: "2-digit", second: "2-digit",
    })
      .formatToParts(time)
      .map(({ type, value }) => [type, value]),
  );
  const local = Date.UTC(parts.year, parts.month - 1, parts.day, parts.hour, parts.minute, parts.second);
  return local - Math.floor(time / 1000) * 1000;
}

// What the daemon is told of the next "06:30" after `start`: it knows the clocks of the site, but not those of a browser.
export function told(text, start) {
  if (sited) return text;
  const [hours, minutes] = text.split(":").map(Number);
  const ahead = offset(start);
  const today = Math.floor((start + ahead) / DAY) * DAY + (hours * 60 + minutes) * 60_000;
  const times = [today, today + DAY].map((time) => time - offset(time - ahead));
  return new Date(times.find((time) => time > start)).toISOString();
}
