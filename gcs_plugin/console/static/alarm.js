// Rings and shows a desktop notification for a call, where the operator has allowed it.

export class Alarm {
  constructor(button) {
    this.button = button;
    this.on = false;
    this.sound = null;
    button.addEventListener("click", () => this.turn());
    this.show();
  }

  async turn() {
    this.on = !this.on;
    if (this.on) {
      this.sound ??= new AudioContext(); // a browser makes sound only after a click
      await this.sound.resume();
      this.beep(0.15);
      if ("Notification" in window && Notification.permission === "default") await Notification.requestPermission();
    }
    this.show();
  }

  show() {
    const notice = "Notification" in window && Notification.permission === "granted";
    this.button.setAttribute("aria-pressed", String(this.on));
    this.button.replaceChildren(this.on ? (notice ? "Sound and notice: on" : "Sound: on") : "Sound: off");
  }

  ring(text) {
    if (!this.on) return;
    for (const at of [0, 0.35, 0.7]) this.beep(0.25, at);
    if ("Notification" in window && Notification.permission === "granted" && document.hidden) new Notification("A rover calls", { body: text });
  }

  beep(seconds, at = 0) {
    const from = this.sound.currentTime + at, tone = this.sound.createOscillator(), volume = this.sound.createGain();
    tone.frequency.value = 740;
    volume.gain.setValueAtTime(0.2, from);
    volume.gain.exponentialRampToValueAtTime(0.001, from + seconds);
    tone.connect(volume).connect(this.sound.destination);
    tone.start(from);
    tone.stop(from + seconds);
  }
}
