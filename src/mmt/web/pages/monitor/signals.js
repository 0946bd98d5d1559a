// Rings of the newest samples, and their spectra.

/** The newest `length` samples; those that a message skipped are null. */
export class Ring {
  constructor(length) {
    this.length = length;
    this.clear();
  }

  /** Add samples of which the last is number `count`; an older number starts anew. */
  add(samples, count) {
    if (samples.length === 0) return;
    const first = count - samples.length;
    if (first < this.count) this.clear();
    const missing = this.count === 0 ? 0 : Math.min(first - this.count, this.values.length);
    for (let i = 0; i < missing; i++) this.values.push(null);
    for (const sample of samples) this.values.push(sample);
    this.values.splice(0, this.values.length - this.length);
    this.count = count;
  }

  clear() {
    this.values = new Array(this.length).fill(null);
    this.count = 0;
  }
}

const SEGMENT = 256;
const COSINE = Float64Array.from({ length: SEGMENT }, (_, i) => Math.cos((2 * Math.PI * i) / SEGMENT));
const HANN = COSINE.map((cosine) => 0.5 - 0.5 * cosine);
const HANN_POWER = HANN.reduce((sum, w) => sum + w * w, 0);

/** Frequencies in Hz of `spectrum`. */
export function frequencies(rateHz) {
  return Array.from({ length: SEGMENT / 2 + 1 }, (_, k) => (k * rateHz) / SEGMENT);
}

/** Welch's estimate in dB re 1 (m/s2)2/Hz: Hann windows of 256, half overlapped; nulls without samples. */
export function spectrum(values, rateHz) {
  const power = new Float64Array(SEGMENT / 2 + 1);
  let segments = 0;
  for (let start = 0; start + SEGMENT <= values.length; start += SEGMENT / 2) {
    const piece = values.slice(start, start + SEGMENT);
    if (piece.includes(null)) continue;
    addPower(piece, power);
    segments++;
  }
  if (segments === 0) return new Array(power.length).fill(null);
  const scale = 2 / (rateHz * HANN_POWER * segments);
  return Array.from(power, (p) => 10 * Math.log10(Math.max(p * scale, 1e-12)));
}

/** Add a piece's power at each frequency: a sum for each is quick enough for a few pieces a second. */
function addPower(piece, power) {
  const mean = piece.reduce((sum, x) => sum + x, 0) / SEGMENT;
  const windowed = Float64Array.from(piece, (x, i) => (x - mean) * HANN[i]);
  for (let k = 0; k < power.length; k++) {
    let re = 0, im = 0;
    for (let i = 0; i < SEGMENT; i++) {
      re += windowed[i] * COSINE[(k * i) % SEGMENT];
      im += windowed[i] * COSINE[(k * i + SEGMENT / 4) % SEGMENT];
    }
    power[k] += re * re + im * im;
  }
}
