const DRIFT = 5e-4; // seconds by which two computers' clocks may part in a second

// Measures by how much events were slower on their way than the quickest one. A slow network keeps them waiting,
// and they would look new. One for each stream.
export class Delay {
  constructor() {
    this.least = Infinity;
    this.measuredAt = 0;
  }

  // sentAt: seconds of the rover's clock. now: seconds of this computer's. Both clocks only go forward.
  late(sentAt, now) {
    this.least = Math.min(now - sentAt, this.least + DRIFT * (now - this.measuredAt));
    this.measuredAt = now;
    return now - sentAt - this.least;
  }
}
