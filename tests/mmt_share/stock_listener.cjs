// A listener of stock parts: npm's socket.io-client and socket.io-msgpack-parser.
// Usage: node stock_listener.cjs URL VARIANCES; prints, as JSON, the model's variances as they grow to that many.
const { io } = require("socket.io-client");
const parser = require("socket.io-msgpack-parser");

const [url, wanted] = [process.argv[2], Number(process.argv[3])];
const heard = { welcome: null, numbers: [], state: null, variances: [] };
const leader = io(url, {
  parser,
  transports: ["websocket"],
  perMessageDeflate: false,
  reconnection: false,
  auth: { sharing: 1, role: "listener", name: "node" },
});

const doubles = (bytes) => Array.from({ length: bytes.length / 8 }, (_, i) => Buffer.from(bytes).readDoubleLE(8 * i));

leader.on("connect_error", (error) => {
  console.error(error.message);
  process.exit(1);
});
leader.on("welcome", (greeting) => {
  heard.welcome = greeting;
  leader.emit("again", null);
});
leader.on("model", (model) => {
  heard.numbers.push(model.number);
  heard.file = Buffer.from(model.file).toString("latin1", 0, 2); // of an archive
});
leader.on("state", (bytes) => {
  const state = Buffer.from(bytes);
  heard.state = { time_s: state.readDoubleLE(0), force_n: state.readFloatLE(32), contact: state.readUInt8(36) };
});
leader.on("change", (change) => {
  heard.numbers.push(change.number);
  const rows = change.rows.find(({ names }) => names.includes("variance"));
  const added = change.arrays.variance ? doubles(change.arrays.variance[2]) : [];
  const before = heard.variances;
  const row = ([first, stop]) => (first < 0 ? added.splice(0, stop) : before.slice(first, stop));
  heard.variances = rows === undefined ? added : rows.plan.flatMap(row);
  if (heard.variances.length >= wanted) {
    leader.disconnect();
    console.log(JSON.stringify(heard));
  }
});
