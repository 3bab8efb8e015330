// How a room does, what it is like, what to do, and when to start heating: the card that the page of a room opens with.

import { get, getIfAny, zonePath } from "./api.js";
import { element, paced, set, svg } from "./dom.js";
import { COLD } from "./ranking.js";
import { said } from "./said.js";
import { capital, duration, number, share, t } from "./text.js";
import { clock, moment, told } from "./time.js";
import { saidNode } from "./words.js";

const ASK_MS = 60_000;
const HEIGHT = 60;
const WORTH = 20;

// The card of zone `id`, whose newest sample ends at `until()`; `failed(error)` is told what went wrong, and null once it works again.
export function roomCard(id, until, failed) {
  const [verdict, about] = [element("div", {}, element("p", { className: "muted", textContent: t("loading") })), element("div", {})];
  const heating = preheatForm(id, until);
  const node = element("section", { className: "card answers" }, element("h2", { textContent: t("room.title") }), verdict, heating.node, about);
  const ask = paced(async () => {
    try {
      const room = await getIfAny(`${zonePath(id)}/room`);
      verdict.replaceChildren(...(room ? toDo(room) : [element("p", { className: "muted", textContent: t("learned.none") })]));
      about.replaceChildren(...(room ? whatItIsLike(room) : []));
      failed(null);
    } catch (error) {
      failed(error);
    }
  }, ASK_MS);
  return { node, ask, heating: heating.foreseen, end: () => ask.cancel() };
}

function toDo({ answers: [verdict], to_do }) {
  const list = to_do.map(({ what, why }) => element("li", {}, element("strong", {}, saidNode(capital(what))), " – ", saidNode(why)));
  return [
    element("p", {}, saidNode(verdict.sentence), "."),
    element("h3", { textContent: t("room.to_do") }),
    list.length ? element("ol", { className: "findings" }, ...list) : element("p", { className: "muted", textContent: t("room.nothing") }),
  ];
}

function whatItIsLike(room) {
  const [, ...others] = room.answers;
  return [
    element("h3", { textContent: t("room.about") }),
    element("ul", { className: "sentences" }, ...others.map(({ about, sentence }) => element("li", {}, element("strong", { textContent: t(`about.${about}`) }), " – ", saidNode(sentence), "."))),
    ...profile(room),
  ];
}

// Heat besides the heating by the hour of the day, as bars: people below, the sun on top of them.
function profile({ sun, people }) {
  const kinds = [people, sun].map((heat) => heat.map((value) => Math.max(0, value ?? 0)));
  const most = Math.max(...kinds[0].map((value, hour) => value + kinds[1][hour]));
  if (most < WORTH) return [];
  const scale = HEIGHT / most;
  const bars = kinds[0].flatMap((own, hour) => {
    const [low, high] = [own * scale, kinds[1][hour] * scale];
    return [
      svg("rect", { x: hour * 10 + 0.6, width: 8.8, y: (HEIGHT - low).toFixed(1), height: low.toFixed(1), class: "people" }),
      svg("rect", { x: hour * 10 + 0.6, width: 8.8, y: (HEIGHT - low - high).toFixed(1), height: high.toFixed(1), class: "sun" }),
    ];
  });
  return [
    element("p", { className: "muted kinds" }, element("span", {}, element("span", { className: "swatch sun" }), t("room.sun")), element("span", {}, element("span", { className: "swatch people" }), t("room.people")), t("room.by_hour", { most: number(most) })),
    svg("svg", { viewBox: `0 0 240 ${HEIGHT}`, class: "profile", preserveAspectRatio: "none", role: "img", "aria-label": t("room.by_hour", { most: number(most) }) }, ...bars),
    element("p", { className: "muted profile-axis", "aria-hidden": "true" }, ...["0", "6", "12", "18", "24"].map((hour) => element("span", { textContent: hour }))),
  ];
}

// "Warm by 06:30 at 21": when to start.
function preheatForm(id, until) {
  const target = element("input", { type: "number", min: "5", max: "35", step: "0.5", value: "21", required: true });
  const by = element("input", { type: "time", value: "06:30", required: true });
  const result = element("p", { role: "status", className: "result" });
  const form = element(
    "form",
    { className: "preheat" },
    element("label", {}, `${t("preheat.by")} `, by),
    element("label", {}, `${t("preheat.at")} `, target, " °C"),
    element("button", { type: "submit", textContent: t("preheat.ask") }),
  );
  let [asked, chosen] = [false, false];
  form.addEventListener("input", () => (chosen = true));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    asked = true;
    try {
      result.textContent = startText(await get(`${zonePath(id)}/preheat?${new URLSearchParams({ target: target.value, by: told(by.value, until()) })}`));
    } catch (error) {
      const { text, lang } = said(error.message);
      result.replaceChildren(element("span", { lang, textContent: text }));
    }
  });
  return {
    node: element("div", {}, element("h3", { textContent: t("preheat.title") }), result, form),
    // The zone's own answer about the next rise of its set-point, at which it is not to be cold, for as long as nobody asks for another time.
    foreseen(answer) {
      if (asked) return;
      set(result, { textContent: answer ? startText({ ...answer, tolerance: COLD }) : "" });
      // The form begins with what the answer is about.
      if (answer && !chosen) [by.value, target.value] = [clock(Date.parse(answer.by)), answer.target];
    },
  };
}

function startText({ start, by, target, tolerance, reached }) {
  const likely = { share: share(reached), target: number(target, 1), tolerance: number(tolerance, 1), by: moment(Date.parse(by)) };
  if (start === null) return t("preheat.late", likely);
  const [begin, end] = [start, by].map((time) => Date.parse(time));
  return t("preheat.start", { ...likely, time: moment(begin), before: duration((end - begin) / 1000) });
}
