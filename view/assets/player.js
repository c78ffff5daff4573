// The time that is shown of a recording: a slider, playing at several speeds.

const element = (id) => document.getElementById(id);

export class Player {
  // `at` is the time shown first.
  constructor(from, to, at) {
    this.time = at;
    this.span = [from, to];
    this.isPlaying = false;
    this.slider = element("time");
    Object.assign(this.slider, { min: from, max: to, value: at });
    element("player").hidden = false;
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    element("play").addEventListener("click", () => this.toggle());
    document.addEventListener("keydown", (event) => {
      const isTyping = ["INPUT", "SELECT", "BUTTON"].includes(event.target.tagName);
      if (event.key !== " " || isTyping) return;
      event.preventDefault();
      this.toggle();
    });
  }

  toggle() {
    this.isPlaying = !this.isPlaying;
    if (this.isPlaying && this.time >= this.span[1]) this.time = this.span[0];
    element("play").textContent = this.isPlaying ? "Pause" : "Play";
  }

  seek(time) {
    this.time = Math.min(this.span[1], Math.max(this.span[0], time));
  }

  // Lets `elapsed` seconds pass; returns the time to show.
  advance(elapsed) {
    if (this.isPlaying) {
      this.seek(this.time + elapsed * Number(element("speed").value));
      if (this.time >= this.span[1]) this.toggle();
    }
    this.slider.value = this.time;
    element("clock").textContent = `${this.time.toFixed(1)} s`.replace("-", "−");
    return this.time;
  }
}
