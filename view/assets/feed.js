// The connection to the server: documents, updates as lines of JSON, commands. The token is kept for this tab alone.

const KEY = "oqtal-token";
const PAUSE_MS = 1000;
const SILENCE_MS = 5000;

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

let previous = Promise.resolve();

// Sends a command of an operator and returns the answer. The server executes one at a time; only a stop does not wait.
export function command(name, args = []) {
  const body = JSON.stringify({ command: name, arguments: args.map(String) });
  const send = async () => (await (await request("control", { method: "POST", body })).text()).trim();
  if (name === "stop") return send();
  const answer = previous.then(send);
  previous = answer.catch(() => {});
  return answer;
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
  const response = await request("live", { signal: abort.signal });
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  begin();
  let rest = "";
  for (;;) {
    const watchdog = setTimeout(() => abort.abort(), SILENCE_MS);
    const { done, value } = await reader.read();
    clearTimeout(watchdog);
    if (done) return;
    const lines = (rest + value).split("\n");
    rest = lines.pop();
    for (const line of lines) take(JSON.parse(line));
  }
}
