// Plays what waits, in the thread that makes sound.

import { Playout } from "./playout.js";

const QUANTA = 2; // between two reports: 5 ms at 48 kHz

class PlayoutProcessor extends AudioWorkletProcessor {
  constructor() {
    super();
    this.playout = new Playout();
    this.quanta = 0;
    this.port.onmessage = ({ data }) => {
      if (data.reset) this.playout.reset();
      else this.playout.add(data.samples, data.number, data.scale);
    };
  }

  process(_, outputs) {
    this.playout.fill(outputs[0][0], currentFrame);
    if (++this.quanta % QUANTA === 0) this.port.postMessage(this.playout.report());
    return true;
  }
}

registerProcessor("mmt-playout", PlayoutProcessor);
