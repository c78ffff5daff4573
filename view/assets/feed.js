// The connection to the server: documents, updates as lines of JSON, commands. The token is kept for this tab alone.

const KEY = "oqtal-token";
const PAUSE_MS = 1000;
const SILENCE_MS = 5000;
// Time within which a command must be answered.
const ANSWER_TIMEOUT_MS = 5000;

export class Refused extends Error {
  constructor(status, text) {
    super(text.trim());
    this.status = status;
  }
}

export function setToken(token) {
  sessionStorage.setItem(KEY, token.trim());
}

export function hasToken() {
  return Boolean(sessionStorage.getItem(KEY));
}

async function request(path, options = {}) {
  const token = sessionStorage.getItem(KEY);
  const headers = token ? { Authorization: `Bearer ${token}` } : {};
  const response = await fetch(path, { ...options, headers });
  if (!response.ok) throw new Refused(response.status, await response.text());
  return response;
}

export async function load(path) {
  return (await request(path)).json();
}

// Time of the newest update, by the server's clock [ms]. The server refuses a command that an interrupted connection has delayed.
let seenMs = 0;
let previous = Promise.resolve();
// Number of times that waiting commands were dropped.
let drops = 0;

// Sends a command of an operator and returns the answer. The server executes one at a time; a stop or a landing does not wait. Commands
// that wait are dropped by them, and if one before is not answered.
export function command(name, args = []) {
  const body = JSON.stringify({ command: name, arguments: args.map(String), seen_ms: seenMs });
  const send = () => post(body);
  if (name === "stop" || name === "land") {
    drops += 1;
    return send();
  }
  const dropsBefore = drops;
  const answer = previous.then(() => {
    if (drops !== dropsBefore) throw new Refused(409, `${name}: not sent; press again`);
    return send();
  });
  previous = answer.catch((error) => {
    if (!(error instanceof Refused)) drops += 1;
  });
  return answer;
}

async function post(body) {
  const signal = AbortSignal.timeout(ANSWER_TIMEOUT_MS);
  return (await (await request("control", { method: "POST", body, signal })).text()).trim();
}

// Calls `take` with each update, and `begin` before the first one of each connection. Connects again for ever; `tell` is told.
// A page that nobody sees is not connected: browsers open six connections to a server at most, one for each page.
export async function follow({ begin, take, tell }) {
  for (;;) {
    await visible();
    try {
      await read(begin, take);
      tell("interrupted");
    } catch (error) {
      tell(error instanceof Refused ? error.message : "the program has ended");
    }
    await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
  }
}

function visible() {
  return new Promise((resolve) => {
    const check = () => {
      if (document.hidden) return;
      document.removeEventListener("visibilitychange", check);
      resolve();
    };
    document.addEventListener("visibilitychange", check);
    check();
  });
}

async function read(begin, take) {
  const abort = new AbortController();
  document.addEventListener("visibilitychange", () => abort.abort(), { once: true });
  const start = () => setTimeout(() => abort.abort(), SILENCE_MS);
  let watchdog = start();
  const response = await request("live", { signal: abort.signal }).finally(() => clearTimeout(watchdog));
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  begin();
  let rest = "";
  for (;;) {
    watchdog = start();
    const { done, value } = await reader.read();
    clearTimeout(watchdog);
    if (done) return;
    const lines = (rest + value).split("\n");
    rest = lines.pop();
    for (const line of lines) {
      const update = JSON.parse(line);
      seenMs = update.at_ms;
      take(update);
    }
  }
}
