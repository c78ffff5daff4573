// Rows and events of the instance or the recording, in the order of time.

const MOST_ROWS = 9000;
const MOST_EVENTS = 500;
// Age of a message above which it does not describe the present state.
const SILENT_S = 1;
// Time without an update after which nothing is known of the present state.
const UPDATE_TIMEOUT_MS = 2500;
// Greatest difference of the rates of two clocks.
const CLOCK_DRIFT = 1e-4;

// Time without a value that a line does not cross, where every row is shown [s].
const GAP_S = 0.25;

export class Store {
  constructor(scene) {
    this.tick = index(scene.tick_columns);
    this.vehicle = index(scene.vehicle_columns);
    this.isBounded = scene.is_live;
    this.gap = GAP_S;
    this.ages = { ticks: { age: null, at: 0 }, vehicles: { age: null, at: 0 } };
    this.begin();
  }

  clear() {
    this.ticks = [];
    this.vehicles = [];
    this.events = [];
    this.version = 0;
    this.isTrue = false;
  }

  // Begins with the updates of another connection.
  begin() {
    this.clear();
    // Delay of the newest update beyond that of the fastest one [s].
    this.lag = 0;
    this.fastest = { offset: Infinity, at: 0 };
  }

  // Records that an update made at `madeAt`, by the server's clock, was received at `now` [ms].
  noteDelay(madeAt, now) {
    const { offset, at } = this.fastest;
    const drifted = offset + (now - at) * CLOCK_DRIFT;
    this.fastest = { offset: Math.min(now - madeAt, drifted), at: now };
    this.lag = (now - madeAt - this.fastest.offset) / 1000;
  }

  // Whether the updates that arrive now describe an earlier state: something between server and page, such as ssh, stores them.
  isBehind() {
    return this.lag > SILENT_S;
  }

  // Adds an update, of which one row in `thinning` is there; a gap of thinned rows is also a row without values.
  // Time that begins again is another flight in virtual time.
  add({ ticks, vehicles, events, thinning = 1 }) {
    this.gap = GAP_S * thinning;
    if (ticks.length && this.ticks.length && ticks[0][0] < this.last(this.ticks)[0]) this.clear();
    append(this.ticks, ticks, this.isBounded ? MOST_ROWS : Infinity);
    append(this.vehicles, vehicles, this.isBounded ? MOST_ROWS : Infinity);
    append(this.events, events, this.isBounded ? MOST_EVENTS : Infinity);
    // A request is received after its effect.
    this.events.sort((a, b) => a.t - b.t);
    const compared = ticks.findLast((row) => row[this.tick.position] !== null);
    // Whether errors are against the truth, not against the estimate.
    if (compared) this.isTrue = compared[this.tick.truth] === 1;
    this.version += 1;
    if (ticks.length) this.setAge("ticks", 0);
    if (vehicles.length) this.setAge("vehicles", 0);
  }

  // Records the age [s] of the newest of these rows, `ticks` or `vehicles`; null if none was received.
  setAge(rows, age) {
    this.ages[rows] = { age, at: performance.now() };
  }

  // Whether the newest of these rows does not describe the present state of an instance.
  isSilent(rows) {
    const { age, at } = this.ages[rows];
    return this.isBounded && (this.isBehind() || age === null || age > SILENT_S || performance.now() - at > UPDATE_TIMEOUT_MS);
  }

  // Whether the position of a tick is neither the truth nor from a recent pose; it is null before the first pose.
  isOld(tick) {
    return !tick[this.tick.truth] && tick[this.tick.age] > SILENT_S * 1000;
  }

  last(rows) {
    return rows[rows.length - 1];
  }

  // Number of rows up to the time `t`.
  until(rows, t) {
    let [low, high] = [0, rows.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (rows[middle][0] <= t) low = middle + 1; else high = middle;
    }
    return low;
  }

  // The row at the time `t`; the first one before all.
  at(rows, t) {
    return rows[Math.max(0, this.until(rows, t) - 1)];
  }
}

function index(columns) {
  return Object.fromEntries(columns.map((name, column) => [name, column]));
}

function append(rows, added, most) {
  for (const row of added) rows.push(row);
  if (rows.length > most) rows.splice(0, rows.length - most + (most >> 3));
}
