// Law and gains of the daemon, changed in flight. Sliders are logarithmic, like the search of `oqtal tune`.

import { significant } from "./charts.js";
import { command } from "./feed.js";

const STEPS = 1000;

const element = (id) => document.getElementById(id);

export class Tuning {
  // `send` sends a command and shows the answer.
  constructor(gains, send) {
    Object.assign(this, { gains, send });
    const laws = [...new Set(gains.map(({ law }) => law))];
    element("law").replaceChildren(...laws.map((law) => new Option(law, law)));
    element("law").addEventListener("change", () => this.change("controller", [element("law").value]));
    element("undo").addEventListener("click", () => this.change("undo", []));
  }

  // Sends a change, and shows the values after it: the daemon may have refused.
  async change(name, args) {
    await this.send(name, args);
    await this.refresh();
  }

  async refresh() {
    try {
      const law = (await command("get", ["control.controller"])).replaceAll('"', "");
      element("law").value = law;
      const own = this.gains.filter((gain) => gain.law === law);
      const values = await Promise.all(own.map(async ({ key }) => Number(await command("get", [key]))));
      element("gains").replaceChildren(...own.map((gain, index) => this.slider(gain, values[index])));
    } catch {
      element("gains").replaceChildren();
    }
  }

  slider({ law, key, low, high }, now) {
    const line = document.createElement("label");
    line.append(key.replace(`control.${law}.`, ""));
    const shown = line.appendChild(document.createElement("output"));
    shown.textContent = significant(now);
    const slider = line.appendChild(document.createElement("input"));
    const [least, greatest] = [Math.min(low, now), Math.max(high, now)];
    const range = Math.log(greatest / least);
    const chosen = () => Number((least * Math.exp((slider.value / STEPS) * range)).toPrecision(3));
    Object.assign(slider, { type: "range", min: 0, max: STEPS, step: 1 });
    slider.value = Math.round((STEPS * Math.log(now / least)) / range);
    slider.addEventListener("input", () => { shown.textContent = significant(chosen()); });
    slider.addEventListener("change", () => this.change("set", [`${key}=${chosen()}`]));
    return line;
  }
}
