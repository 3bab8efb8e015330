// The page: which view is shown, in which language, and how the connection to the daemon is.

import { KeyNeeded, askForKey } from "./access.js";
import { element } from "./dom.js";
import { showOverview } from "./overview.js";
import { chooseLanguage, language, loadTexts, t } from "./text.js";

const RETRY_MS = 2000;
const view = document.getElementById("view");
const connection = document.getElementById("connection");
let end = () => {};
let siteName = "";

const frame = {
  site(name) {
    siteName = name;
    document.getElementById("site").textContent = name;
    title();
  },
  connected() {
    connection.textContent = t("connection.live");
    connection.className = "muted live";
  },
  // `error` ended a request or a stream; the stream tries again by itself.
  lost(error) {
    if (error instanceof KeyNeeded) {
      connection.textContent = t("connection.key");
      connection.className = "muted";
      askForKey(error.message ? t("connection.wrong_key") : "", frame.restart, { label: t("connection.api_key"), open: t("connection.open") });
      return;
    }
    connection.textContent = t("connection.lost");
    connection.title = error.message;
    connection.className = "error";
  },
  restart: () => route(),
};

function title() {
  const zone = shownZone();
  document.title = [zone, siteName, "Thermogate"].filter(Boolean).join(" – ");
}

function shownZone() {
  const match = /^#\/zone\/([^?]+)/.exec(location.hash);
  if (!match) return null;
  try {
    return decodeURIComponent(match[1]);
  } catch {
    return null;
  }
}

let routes = 0;
async function route(moved = false) {
  const turn = (routes += 1);
  end();
  end = () => {};
  connection.textContent = t("connection.connecting");
  connection.className = "muted";
  const zone = shownZone();
  title();
  if (zone === null) end = showOverview(view, frame);
  else {
    view.replaceChildren(element("p", { className: "muted", textContent: t("loading") }));
    try {
      const { showZone } = await import("./zone.js");
      if (turn !== routes) return;
      end = showZone(view, frame, zone);
    } catch (error) {
      if (turn !== routes) return;
      frame.lost(error);
      setTimeout(() => turn === routes && route(), RETRY_MS);
    }
  }
  if (moved) {
    window.scrollTo(0, 0);
    view.focus({ preventScroll: true });
  }
}

function words() {
  document.getElementById("skip").textContent = t("skip");
  document.getElementById("language-label").textContent = t("language");
  document.getElementById("footer").textContent = t("footer");
  document.getElementById("links").setAttribute("aria-label", t("links"));
  document.getElementById("language").value = language;
}

document.getElementById("language").addEventListener("change", async (event) => {
  await chooseLanguage(event.target.value);
  words();
  route();
});
document.getElementById("skip").addEventListener("click", (event) => {
  event.preventDefault();
  view.focus();
});
window.addEventListener("hashchange", () => route(true));
await loadTexts();
words();
route();
