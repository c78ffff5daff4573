// Commands of an operator: the token first, then arm (twice, to be sure), land, stop, go to a point, and change law and gains.

import { Refused, command, hasToken, setToken } from "./feed.js";
import { Tuning } from "./tuning.js";

const SURE_MS = 4000;

const element = (id) => document.getElementById(id);

let tuning;

export function offerControl(scene) {
  element("control").hidden = false;
  element("unlock").addEventListener("submit", (event) => {
    event.preventDefault();
    setToken(element("token").value);
    element("token").value = "";
    unlock();
  });
  let sure = 0;
  element("arm").addEventListener("click", () => {
    clearTimeout(sure);
    const isSure = element("arm").classList.toggle("sure");
    element("arm").textContent = isSure ? "Sure?" : "Arm";
    if (isSure) sure = setTimeout(() => element("arm").classList.contains("sure") && reset(), SURE_MS);
    else send("arm");
  });
  element("hover").addEventListener("click", () => send("hover"));
  element("goto").addEventListener("submit", (event) => {
    event.preventDefault();
    send("goto", ["goto-x", "goto-y", "goto-z"].map((id) => element(id).value));
  });
  tuning = new Tuning(scene.gains, send);
  // Both drop the commands that wait, also those that ask for gains.
  for (const end of ["land", "stop"]) element(end).addEventListener("click", () => tuning.change(end, []));
  if (hasToken()) unlock();
}

function reset() {
  element("arm").classList.remove("sure");
  element("arm").textContent = "Arm";
}

// Asks for the status, which needs the token as well.
async function unlock() {
  if (!(await send("status"))) return;
  element("unlock").hidden = true;
  element("commands").hidden = false;
  element("tuning").hidden = false;
  tuning.refresh();
}

// Sends a command and shows the answer; returns whether the token is right.
async function send(name, args = []) {
  const answer = element("answer");
  answer.className = "answer muted";
  answer.textContent = `${name} …`;
  try {
    answer.textContent = await command(name, args);
    return true;
  } catch (error) {
    answer.className = "answer bad";
    answer.textContent = error instanceof Refused ? error.message : `${name}: no answer; it is not known whether it was received`;
    if (error.status === 401) {
      element("unlock").hidden = false;
      element("commands").hidden = true;
      element("tuning").hidden = true;
    }
    return error instanceof Refused && error.status !== 401;
  }
}
