// A table of rooms of which only the rows in view exist in the page.

import { element, set } from "./dom.js";
import { outdone } from "./ranking.js";
import { said } from "./said.js";
import { sparkline } from "./spark.js";
import { celsius, duration, number, t } from "./text.js";
import { timeNode } from "./time.js";
import { rowTold, stateText, trustText } from "./words.js";

const BEYOND = 8;
const HEADS = [
  ["room", "room"],
  ["now", "now"],
  ["hour", "hour"],
  ["later", "later"],
  ["state", "state"],
  ["trust", "trust"],
  ["worst", "finding"],
  [null, "spark"],
];

// The columns that look ahead, and how far, in s.
const LEADS = [["hour", 3600], ["later", 6 * 3600]];

// `sorting()` tells the column and direction in force, `sort(column)` is called when a head is chosen.
export function roomTable({ sorting, sort }) {
  const heads = HEADS.map(([column, name]) => headCell(column, name, sort));
  const body = element("tbody", { role: "rowgroup" });
  const above = element("tr", { className: "beyond", role: "presentation" }, element("td"));
  const below = element("tr", { className: "beyond", role: "presentation" }, element("td"));
  const node = element(
    "table",
    { className: "rooms", role: "table", "aria-label": t("overview.title") },
    element("thead", { role: "rowgroup" }, element("tr", { role: "row", "aria-rowindex": "1" }, ...heads.map(({ cell }) => cell))),
    body,
  );
  const drawn = new Map();
  let rows = [];
  let everything = false;
  let frame = 0;

  function rowHeight() {
    return parseFloat(getComputedStyle(node).getPropertyValue("--row"));
  }

  function draw() {
    frame = 0;
    if (!node.isConnected) return;
    const height = rowHeight();
    const top = body.getBoundingClientRect().top;
    const first = everything ? 0 : Math.max(0, Math.floor(-top / height) - BEYOND);
    const last = everything ? rows.length : Math.min(rows.length, Math.ceil((window.innerHeight - top) / height) + BEYOND);
    const focused = document.activeElement?.closest?.("tr[data-zone]")?.dataset.zone;
    const wanted = rows.map((row, index) => [row, index]).slice(first, Math.max(first, last));
    // The row with the focus stays, wherever it is: a reader who tabs must not lose the place.
    const away = focused === undefined ? -1 : rows.findIndex(({ id }) => id === focused);
    const kept = new Set(wanted.map(([{ id }]) => id));
    for (const [id, one] of drawn) {
      if (!kept.has(id) && !(id === focused && away >= 0)) {
        one.node.remove();
        drawn.delete(id);
      }
    }
    const nodes = wanted.map(([row, index]) => {
      if (!drawn.has(row.id)) drawn.set(row.id, roomRow(row.id));
      const one = drawn.get(row.id);
      one.draw(row, index);
      return one.node;
    });
    if (away >= 0 && !kept.has(focused)) {
      const one = drawn.get(focused);
      one.draw(rows[away], away);
      one.node.classList.add("aside");
      nodes[away < first ? "unshift" : "push"](one.node);
    }
    for (const [id, one] of drawn) if (kept.has(id)) one.node.classList.remove("aside");
    above.firstChild.style.height = `${first * height}px`;
    below.firstChild.style.height = `${(rows.length - Math.max(first, last)) * height}px`;
    arrangeChildren(body, [above, ...nodes, below]);
  }

  function ask() {
    frame ||= requestAnimationFrame(draw);
  }
  function printing(all) {
    everything = all;
    draw();
  }
  const before = () => printing(true);
  const after = () => printing(false);
  window.addEventListener("scroll", ask, { passive: true });
  window.addEventListener("resize", ask);
  window.addEventListener("beforeprint", before);
  window.addEventListener("afterprint", after);

  return {
    node,
    show(ordered) {
      rows = ordered;
      const { sort: column, descending } = sorting();
      for (const head of heads) head.mark(column, descending);
      // Zones whose period is seconds look seconds ahead; a site has either these or others.
      LEADS.forEach(([name, usual], index) => {
        const lead = rows.find(({ expected }) => expected[index])?.expected[index].lead_s ?? usual;
        heads[HEADS.findIndex(([, head]) => head === name)].name(t("overview.ahead", { lead: duration(lead) }));
      });
      node.classList.toggle("without-trust", !rows.some(({ trust }) => trust));
      node.setAttribute("aria-rowcount", String(rows.length + 1));
      ask();
    },
    end() {
      cancelAnimationFrame(frame);
      window.removeEventListener("scroll", ask);
      window.removeEventListener("resize", ask);
      window.removeEventListener("beforeprint", before);
      window.removeEventListener("afterprint", after);
    },
  };
}

// Puts `wanted` in this order with as few moves as there are; a node that stays keeps its focus.
function arrangeChildren(parent, wanted) {
  const focused = document.activeElement;
  let next = parent.firstChild;
  for (const node of wanted) {
    if (node === next) next = next.nextSibling;
    else parent.insertBefore(node, next);
  }
  while (next) {
    const after = next.nextSibling;
    next.remove();
    next = after;
  }
  if (focused && focused !== document.activeElement && parent.contains(focused)) focused.focus({ preventScroll: true });
}

function headCell(column, name, sort) {
  const text = name === "hour" || name === "later" ? "" : t(`overview.${name}`);
  const cell = element("th", { role: "columnheader", scope: "col", className: `cell-${name}` });
  if (column === null) {
    cell.append(text);
    return { cell, mark() {} };
  }
  const button = element("button", { type: "button", textContent: text });
  button.addEventListener("click", () => sort(column));
  cell.append(button);
  return {
    cell,
    name(own) {
      button.textContent = own;
    },
    mark(sorted, descending) {
      set(cell, { "aria-sort": sorted === column ? (descending ? "descending" : "ascending") : "none" });
    },
  };
}

function roomRow(id) {
  const cell = (name) => element("td", { role: "cell", className: `cell-${name}` });
  const cells = Object.fromEntries(HEADS.map(([, name]) => [name, cell(name)]));
  const link = element("a", { href: `#/zone/${encodeURIComponent(id)}`, textContent: id });
  const since = element("span", { className: "since muted" });
  cells.room.append(link, since);
  const pill = element("span", { className: "pill" });
  cells.state.append(pill);
  const finding = element("span");
  cells.finding.append(finding);
  const spark = sparkline();
  cells.spark.append(spark.node);
  const node = element("tr", { role: "row", "data-zone": id }, ...Object.values(cells));
  let shown = null;
  return {
    node,
    draw(row, index) {
      set(node, { "aria-rowindex": String(index + 2) });
      if (row === shown) return;
      shown = row;
      const old = row.state !== "running" && row.sample_time;
      since.replaceChildren(...(old ? [timeNode(Date.parse(row.sample_time))] : []));
      const meant = row.setpoint === null ? [] : [" ", element("span", { className: "meant muted", textContent: t("overview.meant", { setpoint: number(row.setpoint, 1) }) })];
      cells.now.replaceChildren(celsius(row.temperature), ...meant);
      LEADS.forEach(([name], index) => {
        const one = row.expected[index];
        const title = one ? t("overview.interval", { lead: duration(one.lead_s), low: number(one.lower, 1), high: number(one.upper, 1) }) : "";
        set(cells[name], { textContent: celsius(one?.mean), title, "data-ahead": t("overview.ahead", { lead: duration(one?.lead_s ?? LEADS[index][1]) }) });
      });
      set(pill, { textContent: stateText(row.state), className: `pill ${row.state}` });
      const trust = outdone(row) ? "partly" : row.trust;
      const { text, lang } = rowTold(row);
      const why = row.trust_reason ? said(row.trust_reason) : { text: "", lang: "" };
      // Not green beside the word that something else is to be taken with care now.
      const warned = trust === "trusted" && (row.disturbed || row.reason);
      set(cells.trust, { title: why.text, className: `cell-trust trust-${warned ? "warned" : trust ?? "unknown"}` });
      // Where the gap lies below the hours that are trusted, "up to" would deny these.
      const horizon = outdone(row) && row.good_up_to_s >= LEADS[1][1] ? t("trust.up_to", { lead: duration(row.good_up_to_s) }) : trustText(trust);
      // Read out once, where it is not the finding as well.
      cells.trust.replaceChildren(horizon, ...(why.text && why.text !== text ? [element("span", { className: "hidden-text", lang: why.lang, textContent: `: ${why.text}` })] : []));
      set(finding, { textContent: text, title: text, lang });
      spark.draw(row.spark, row.spark ? sparkText(row.spark) : t("overview.no_spark"));
    },
  };
}

function sparkText({ values }) {
  const known = values.filter((value) => value !== null);
  if (!known.length) return t("overview.no_spark");
  return t("overview.spark_text", { low: celsius(Math.min(...known)), high: celsius(Math.max(...known)) });
}
