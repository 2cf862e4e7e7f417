// Reads a bag with the official JavaScript reader of mcap, the one that Foxglove uses:
//   npm install --prefix /tmp/mcap @mcap/core @foxglove/wasm-zstd
//   NODE_PATH=/tmp/mcap/node_modules node tools/read_bag.mjs FILE.mcap
// Decompresses every chunk, checks every checksum, and prints each topic with its schema and number
// of messages, as JSON.
import { open } from "node:fs/promises";
import { createRequire } from "node:module";

const require = createRequire(import.meta.url);
const { McapIndexedReader } = require("@mcap/core");
const zstd = require("@foxglove/wasm-zstd");

if (process.argv.length !== 3) {
  console.error("usage: node tools/read_bag.mjs FILE.mcap");
  process.exit(2);
}
const file = await open(process.argv[2]);
await zstd.isLoaded;
const reader = await McapIndexedReader.Initialize({
  readable: {
    size: async () => BigInt((await file.stat()).size),
    read: async (offset, length) => {
      const buffer = new Uint8Array(Number(length));
      await file.read(buffer, 0, Number(length), Number(offset));
      return buffer;
    },
  },
  decompressHandlers: { zstd: (data, size) => zstd.decompress(data, Number(size)) },
});
const topics = {};
let schemaBytes = 0;
for (const channel of reader.channelsById.values()) {
  const schema = reader.schemasById.get(channel.schemaId);
  schemaBytes += schema.data.length;
  topics[channel.topic] = {
    schema: schema.name,
    schemaEncoding: schema.encoding,
    messageEncoding: channel.messageEncoding,
    messages: 0,
  };
}
let previous = 0n;
for await (const message of reader.readMessages({ validateCrcs: true })) {
  if (message.logTime < previous) {
    throw new Error("messages are not in the order of log_time");
  }
  previous = message.logTime;
  topics[reader.channelsById.get(message.channelId).topic].messages += 1;
}
await file.close();
const total = Object.values(topics).reduce((sum, topic) => sum + topic.messages, 0);
const compressions = [...new Set(reader.chunkIndexes.map((chunk) => chunk.compression))];
const statistics = Number(reader.statistics.messageCount);
console.log(JSON.stringify({ total, statistics, compressions, schemaBytes, topics }, null, 1));
process.exit(total === statistics ? 0 : 1);
