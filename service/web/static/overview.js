// The overview: every room in a table, the worst first. One request, one stream, and only the rows in view drawn.

import { get } from "./api.js";
import { element, paced, set } from "./dom.js";
import { STATES, needsAttention, ranked } from "./ranking.js";
import { roomTable } from "./room_table.js";
import { follow } from "./stream.js";
import { number, t } from "./text.js";
import { useTimeZone } from "./time.js";
import { rowText, stateText } from "./words.js";

const SORT_MS = 500;

// What was chosen outlives a visit to a zone.
const chosen = { filter: "all", search: "", sort: "worst", descending: false };

// Shows the overview in `place`; `frame` shows the site's name and the connection. Returns what ends it.
export function showOverview(place, frame) {
  const rows = new Map();
  const order = element("span", { className: "order muted" });
  const head = element("h1", {}, t("overview.title"), " ", order);
  const counts = element("div", { className: "filters", role: "group", "aria-label": t("overview.filter") });
  const search = element("input", { type: "search", id: "search", value: chosen.search, placeholder: t("overview.search"), autocomplete: "off", spellcheck: false, "aria-label": t("overview.search") });
  const found = element("p", { className: "muted hidden-text", role: "status" });
  const table = roomTable({
    sorting: () => chosen,
    sort(column) {
      chosen.descending = chosen.sort === column && column !== "worst" ? !chosen.descending : false;
      chosen.sort = column;
      arrange();
    },
  });
  const filters = ["all", "attention", ...STATES].map((filter) => {
    const button = element("button", { type: "button", className: "filter", "data-filter": filter });
    button.addEventListener("click", () => {
      chosen.filter = filter;
      arrange();
    });
    counts.append(button);
    return [filter, button];
  });
  const empty = element("p", { className: "muted", hidden: true });
  place.replaceChildren(head, element("div", { className: "tools" }, search, counts), found, table.node, empty);
  search.addEventListener("input", () => {
    chosen.search = search.value;
    arrange();
  });

  function countedFilters() {
    for (const [filter, button] of filters) {
      let count = 0;
      for (const row of rows.values()) if (filter === "all" || (filter === "attention" ? needsAttention(row) : row.state === filter)) count += 1;
      const name = filter === "all" || filter === "attention" ? t(`overview.${filter}`) : stateText(filter);
      const text = `${name} ${number(count)}`;
      set(button, { textContent: text, "aria-pressed": String(chosen.filter === filter), hidden: count === 0 && chosen.filter !== filter && filter !== "all" });
    }
  }

  function arrange() {
    countedFilters();
    order.textContent = chosen.sort === "worst" && rows.size > 1 ? t("overview.worst") : "";
    const shown = ranked([...rows.values()], { ...chosen, words: rowText });
    table.show(shown);
    empty.hidden = shown.length > 0;
    empty.textContent = rows.size ? t("overview.nothing") : t("overview.none");
    found.textContent = t("overview.found", { shown: number(shown.length), all: number(rows.size) });
  }
  const rearrange = paced(arrange, SORT_MS);

  function take(change) {
    for (const row of change.zones) rows.set(row.id, { ...row, spark: row.spark ?? rows.get(row.id)?.spark ?? null });
    for (const id of change.removed) rows.delete(id);
  }

  let loading = null;
  // News that came while the whole is on its way, which may be older.
  let early = null;
  async function load() {
    loading?.abort();
    loading = new AbortController();
    early = [];
    const overview = await get("overview", loading.signal);
    frame.site(overview.site);
    useTimeZone(overview.time_zone);
    const listed = new Set(overview.zones.map(({ id }) => id));
    take({ zones: overview.zones, removed: [...rows.keys()].filter((id) => !listed.has(id)) });
    early.forEach(take);
    early = null;
    arrange();
    frame.connected();
  }

  const stop = follow("overview/stream", {
    opened: load,
    event(kind, change) {
      if (kind !== "rows") return;
      if (early) {
        early.push(change);
        return;
      }
      take(change);
      frame.connected();
      rearrange();
    },
    lost: (error) => frame.lost(error),
  });
  return () => {
    loading?.abort();
    rearrange.cancel();
    table.end();
    stop();
  };
}

