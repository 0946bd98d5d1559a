// What waits to be played. Without a page and a socket: it runs where sound is made.

const ROOM = 1 << 17;
const RELEASE = 0.97; // a sample to the next, where samples are lacking: silent in some 3 ms
const RETURN = 96; // samples over which the sound comes back
const LINEAR = 0.8;

/** Bound a value softly: linear to 0.8, never beyond 1. */
export function limited(value) {
  const size = Math.abs(value);
  if (!(size > LINEAR)) return size >= 0 ? value : 0; // not a number is silence
  return Math.sign(value) * (LINEAR + (1 - LINEAR) * Math.tanh((size - LINEAR) / (1 - LINEAR)));
}

export class Playout {
  constructor() {
    this.ring = new Float32Array(ROOM);
    this.reset();
  }

  /** Begin anew: nothing waits, and nothing was played. */
  reset() {
    this.added = 0;
    this.played = 0;
    this.running = false;
    this.gain = 0;
    this.last = 0;
    this.marks = [];
    this.forget();
  }

  /** Let samples wait; `number` is that of the request which they answer. */
  add(samples, number, scale) {
    if (samples.length > ROOM - (this.added - this.played)) return;
    if (samples.length) {
      this.marks.push([number, this.added]);
      if (this.marks.length > 512) this.marks.shift();
    }
    for (const sample of samples) this.ring[this.added++ % ROOM] = limited(sample * scale);
    this.running ||= samples.length > 0;
  }

  /** Write what is due, and fade to silence where there is nothing; `frame` is the first one's. */
  fill(output, frame) {
    if (this.running) this.least = Math.min(this.least, this.added - this.played - output.length);
    for (let i = 0; i < output.length; i++) {
      if (this.played < this.added) {
        if (this.marks.length && this.marks[0][1] === this.played) {
          this.heard.push([this.marks.shift()[0], frame + i]);
        }
        this.gain = Math.min(1, this.gain + 1 / RETURN);
        this.last = this.ring[this.played++ % ROOM] * this.gain;
      } else {
        this.gain = 0;
        this.last *= RELEASE;
        if (this.running) this.lacked++;
      }
      output[i] = this.last;
      this.square += this.last * this.last;
    }
    this.counted += output.length;
  }

  /** Return what happened since the last report. */
  report() {
    const { played, least, lacked, heard, counted } = this;
    const rms = Math.sqrt(this.square / Math.max(counted, 1));
    this.forget();
    return { played, least, lacked, heard, rms, counted };
  }

  forget() {
    this.least = Infinity;
    this.lacked = 0;
    this.heard = [];
    this.square = 0;
    this.counted = 0;
  }
}
