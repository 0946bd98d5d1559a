// Renders by the page's module, under Node: reads one request from stdin, prints the answer.

import { readFileSync } from "node:fs";

const [path] = process.argv.slice(2);
const source = readFileSync(path).toString("base64");
const { parseModel, render, Synthesizer, RateConverter, ModelError } = await import(`data:text/javascript;base64,${source}`);

const floats = (text) => new Float64Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const coded = (samples) => Buffer.from(samples.buffer, samples.byteOffset, samples.byteLength).toString("base64");
const { forms, inputs, excitation, renewal, rates, converted: first, changes } = JSON.parse(readFileSync(0, "utf8"));

try {
  const models = forms.map(parseModel);
  const motion = inputs.map(floats), white = floats(excitation);
  const synthesizer = new Synthesizer(models[0], { renewalSamples: renewal });
  const parts = models.map((model, number) => {
    synthesizer.model = model;
    const part = (values) => values.subarray(changes[number], changes[number + 1]);
    return synthesizer.render(motion.map(part), part(white));
  });
  const samples = Float64Array.from(parts.flatMap((part) => [...part]));
  const converted = rates.map((rate) => coded(new RateConverter(models[0].rateHz, rate).convert(samples.subarray(0, first))));
  const called = renewal === 1 && models.length === 1 ? coded(render(models[0], ...motion, white)) : null;
  console.log(JSON.stringify({ samples: coded(samples), converted, called }));
} catch (error) {
  if (!(error instanceof ModelError)) throw error;
  console.log(JSON.stringify({ refused: error.message }));
}
