// Reads an MCAP file as Foxglove does, and prints a JSON line for each message.
// The index is used where the file has one; a file that was cut off is read as a stream.

import { readFile } from "node:fs/promises";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { loadDecompressHandlers } from "@mcap/support";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";

const bytes = await readFile(process.argv[2]);
const decompressHandlers = await loadDecompressHandlers();
const schemas = new Map();
const channels = new Map();
const readers = new Map();

async function* indexed() {
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (offset, size) => bytes.subarray(Number(offset), Number(offset + size)),
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  reader.schemasById.forEach((schema, id) => schemas.set(id, schema));
  reader.channelsById.forEach((channel, id) => channels.set(id, channel));
  yield* reader.readMessages();
}

function* streamed() {
  const reader = new McapStreamReader({ decompressHandlers });
  reader.append(bytes);
  for (let record = reader.nextRecord(); record; record = reader.nextRecord()) {
    if (record.type === "Schema") schemas.set(record.id, record);
    if (record.type === "Channel") channels.set(record.id, record);
    if (record.type === "Message") yield record;
  }
}

function decode(message) {
  const channel = channels.get(message.channelId);
  const schema = schemas.get(channel.schemaId);
  if (!readers.has(channel.schemaId)) {
    const definitions = parse(new TextDecoder().decode(schema.data), { ros2: true });
    readers.set(channel.schemaId, new MessageReader(definitions));
  }
  const value = readers.get(channel.schemaId).readMessage(message.data);
  if (schema.name === "sensor_msgs/msg/PointCloud2") value.points = points(value);
  return { topic: channel.topic, type: schema.name, sequence: message.sequence, value };
}

function points(cloud) {
  const { buffer, byteOffset, byteLength } = cloud.data;
  const view = new DataView(buffer, byteOffset, byteLength);
  const columns = {};
  for (const { name, offset, datatype } of cloud.fields) {
    columns[name] = Array.from({ length: cloud.width }, (_, row) => {
      const place = row * cloud.point_step + offset;
      return datatype === 7 ? view.getFloat32(place, true) : view.getUint8(place);
    });
  }
  return columns;
}

function plain(_, value) {
  if (typeof value === "bigint") return Number(value);
  return ArrayBuffer.isView(value) ? Array.from(value) : value;
}

const messages = process.argv[3] === "--stream" ? streamed() : indexed();
for await (const message of messages) {
  process.stdout.write(JSON.stringify(decode(message), plain) + "\n");
}
