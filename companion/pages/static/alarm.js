// Tells of a call by sound and vibration, and by a notice of the system while nobody sees the page. Only once somebody has allowed it.

const BUZZ = [300, 150, 300, 150, 300]; // ms

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
    this.show();
    if (!this.on) return;
    this.sound ??= new AudioContext(); // a browser makes sound only after a click
    await this.sound.resume();
    this.beep(0.15);
    if (mayAsk()) await Notification.requestPermission();
    this.show();
  }

  show() {
    const why = allowed() ? "" : globalThis.isSecureContext ? " (your browser allows no notices)" : " (notices need https, or ssh to localhost)";
    this.button.setAttribute("aria-pressed", String(this.on));
    this.button.replaceChildren(!this.on ? "Sound and notice: off" : allowed() ? "Sound and notice: on" : `Sound: on${why}`);
  }

  // tag: the same for the same call, so that several pages of one rover show one notice.
  ring(text, tag) {
    if (!this.on) return;
    for (const at of [0, 0.35, 0.7]) this.beep(0.25, at);
    navigator.vibrate?.(BUZZ);
    if (!allowed() || !document.hidden) return;
    try {
      const notice = new Notification("A rover calls", { body: text, tag });
      notice.onclick = () => { window.focus(); notice.close(); };
    } catch {
      // Chrome on Android shows notices of service workers only; sound and vibration are left.
    }
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

const allowed = () => "Notification" in window && Notification.permission === "granted";
const mayAsk = () => "Notification" in window && Notification.permission === "default";
