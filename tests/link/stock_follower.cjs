// A follower of stock parts: npm's socket.io-client and socket.io-msgpack-parser.
// Usage: node stock_follower.cjs URL FRAMES PROTOCOL plain|compressed; prints what it received as JSON.
const { io } = require("socket.io-client");
const parser = require("socket.io-msgpack-parser");

const [url, wanted] = [process.argv[2], Number(process.argv[3])];
const heard = { welcome: null, sizes: [], commands: [] };

const leader = io(url, {
  parser,
  transports: ["websocket"],
  perMessageDeflate: process.argv[5] === "compressed" ? { threshold: 0 } : false,
  reconnection: false,
  auth: {
    protocol: Number(process.argv[4]),
    rate_hz: 1000,
    channels: ["position", "force"],
    frames_per_message: 1,
    source: "stock client",
    clock_id: "node",
    annotations: Buffer.from("any bytes"),
  },
});

function frame(sequence) {
  const bytes = Buffer.alloc(36);
  bytes.writeUInt32LE(sequence, 0);
  bytes.writeBigInt64LE(process.hrtime.bigint(), 4);
  [sequence + 0.25, 0.5, 0.75, 0, 0, -1.5].forEach((value, i) => bytes.writeFloatLE(value, 12 + 4 * i));
  return bytes;
}

function command(bytes) {
  return {
    sequence: bytes.readUInt32LE(0),
    time_ns: String(bytes.readBigInt64LE(4)),
    echo_time_ns: String(bytes.readBigInt64LE(12)),
    echo_age_ns: String(bytes.readBigInt64LE(20)),
    position_mm: [28, 32, 36].map((offset) => bytes.readFloatLE(offset)),
  };
}

function finish() {
  leader.emit("end", { reason: "node is done", frames: wanted }, () => {
    leader.disconnect();
    console.log(JSON.stringify(heard));
  });
}

leader.on("connect_error", (error) => {
  console.error(error.message);
  process.exit(1);
});

leader.on("welcome", (greeting) => {
  heard.welcome = greeting;
  const begun = performance.now();
  let sent = 0;
  const ticking = setInterval(() => {
    while (sent < wanted && begun + sent <= performance.now()) leader.emit("frames", frame(sent++));
    if (sent === wanted) clearInterval(ticking);
  }, 1);
});

leader.on("commands", (data) => {
  const bytes = Buffer.from(data);
  heard.sizes.push(bytes.length);
  for (let start = 0; start < bytes.length; start += 40) {
    heard.commands.push(command(bytes.subarray(start, start + 40)));
  }
  if (heard.commands.length === wanted) finish();
});
