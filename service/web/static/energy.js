// How much heat a zone's thermostat will call for, and what a plan of set-points changes about it, in sentences.

import { Refused, post, zonePath } from "./api.js";
import { element } from "./dom.js";
import { COLD } from "./ranking.js";
import { number, signed, t } from "./text.js";
import { saidNode } from "./words.js";

// What the thermostat of zone `id` will call for over `horizon` without a plan.
export function demandTold(id, horizon, signal) {
  return told(`${zonePath(id)}/demand`, { horizon }, signal, ({ total: { mean, lower, upper } }) =>
    t("energy.demand", { energy: number(mean, 1), low: number(lower, 1), high: number(upper, 1) }),
  );
}

// What `setpoints`, one for each step, change over `horizon`, which ends before `after` (ms), against the likeliest.
export function changeTold(id, horizon, setpoints, after, signal) {
  // Until the first value of a plan come the likeliest.
  const likeliest = [{ time: new Date(after).toISOString(), value: setpoints[0] }];
  const plans = [{ name: "likeliest", T_set: likeliest }, { name: "planned", T_set: setpoints }];
  return told(`${zonePath(id)}/what-if`, { horizon, plans }, signal, ({ differences: [{ energy, hours_below: hours }] }) =>
    t("energy.change", {
      energy: signed(energy.mean, 1),
      low: signed(energy.lower, 1),
      high: signed(energy.upper, 1),
      hours: signed(hours.mean, 1),
      least: signed(hours.lower, 1),
      most: signed(hours.upper, 1),
      cold: number(COLD, 1),
    }),
  );
}

// The answer in words, or why there is none to rely on; nothing while there is no forecast.
async function told(path, body, signal, words) {
  try {
    return words(await post(path, body, signal));
  } catch (error) {
    if (error instanceof Refused && error.status === 409) return element("span", {}, `${t("energy.unknown")} `, saidNode(error.message));
    if (error instanceof Refused && error.status === 503) return "";
    throw error;
  }
}
