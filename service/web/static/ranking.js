// Which zones come first: the worst, then by name. Filters and searches. No page in here.

export const STATES = ["failed", "stalled", "waiting", "running"];
const STATE_WEIGHT = { failed: 400, stalled: 300, waiting: 150, running: 0 };
const TRUST_WEIGHT = { untrusted: 200, doubtful: 100, learning: 20, trusted: 0 };
const FINDING_WEIGHT = 20;
// What only those who read parameters can do something about; anything else is wrong with telemetry, heating or model.
const FOR_EXPERTS = new Set(["parameter-at-bound", "parameter-not-identified", "members-disagree", "network-variant", "narrower-bounds"]);

// The findings that somebody should do something about.
export function pressing({ findings }) {
  return findings.filter(({ finding }) => !FOR_EXPERTS.has(finding));
}

// Whether a simpler forecast is better at some horizon, although that of 6 h ahead is trusted.
export function outdone(row) {
  return row.trust === "trusted" && Boolean(row.trust_reason);
}

// K below its set-point from which a room is cold, as in the answers about a room.
export const COLD = 0.5;

// By how many K a room is colder than it is meant to be; 0 where it is not, has yet to warm up, or nobody knows.
export function coldBy({ temperature, setpoint, risen }) {
  const by = risen || setpoint === null || temperature === null ? 0 : setpoint - temperature;
  return by > COLD ? by : 0;
}

// The larger, the more a zone needs somebody.
export function severity(row) {
  const findings = FINDING_WEIGHT * pressing(row).length;
  const uncomfortable = row.often ? 1 + row.often_h / 24 : 0;
  return (STATE_WEIGHT[row.state] ?? 0) + (TRUST_WEIGHT[row.trust] ?? 0) + (row.reason && row.state === "running" ? 50 : 0) + Math.min(80, findings) + (row.disturbed ? 10 : 0) + Math.min(12, 6 * coldBy(row)) + uncomfortable + (outdone(row) ? 0.01 : 0);
}

// Whether somebody should look: the room does not run as it should, or its own page names something to do.
export function needsAttention(row) {
  return row.state !== "running" || Boolean(row.reason) || row.to_do;
}

const collator = new Intl.Collator(undefined, { numeric: true });
const mean = (expected) => expected?.mean ?? null;

export const COLUMNS = {
  worst: (row) => -severity(row),
  room: (row) => row.id,
  now: (row) => row.temperature,
  hour: (row) => mean(row.expected[0]),
  later: (row) => mean(row.expected[1]),
  state: (row) => STATES.indexOf(row.state),
  trust: (row) => -(TRUST_WEIGHT[row.trust] ?? -1),
};

// The rows to show, in order. `sort` is one of COLUMNS; rows without a value come last, either way.
export function ranked(rows, { filter = "all", search = "", sort = "worst", descending = false, words = () => "" }) {
  const wanted = search.trim().toLocaleLowerCase();
  const shown = rows.filter(
    (row) =>
      (filter === "all" || (filter === "attention" ? needsAttention(row) : row.state === filter)) &&
      (!wanted || `${row.id} ${words(row)}`.toLocaleLowerCase().includes(wanted)),
  );
  const key = COLUMNS[sort];
  const sign = descending ? -1 : 1;
  const keyed = shown.map((row) => [key(row), row]);
  keyed.sort(([a, first], [b, second]) => {
    if (a === null || b === null) return (a === null) - (b === null) || collator.compare(first.id, second.id);
    const order = typeof a === "string" ? collator.compare(a, b) : a - b;
    return sign * order || collator.compare(first.id, second.id);
  });
  return keyed.map(([, row]) => row);
}
