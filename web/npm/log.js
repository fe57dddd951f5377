// LCM logs (tm-sim --record, lcm-logger) as messages, one list a channel. The types are read from their definitions (messages.js).
import { definitions } from './messages.js';
import { TensormassError } from './runtime.js';

const SYNC = 0xeda1da01, WIDTH = { int8_t: 1, byte: 1, boolean: 1, int16_t: 2, int32_t: 4, int64_t: 8, float: 4, double: 8 };
const READ = {
  int8_t: (v, at) => v.getInt8(at), byte: (v, at) => v.getUint8(at), boolean: (v, at) => v.getInt8(at) !== 0, int16_t: (v, at) => v.getInt16(at),
  int32_t: (v, at) => v.getInt32(at), int64_t: (v, at) => v.getBigInt64(at), float: (v, at) => v.getFloat32(at), double: (v, at) => v.getFloat64(at),
};

// One message type, read from the text of its definition: members, fingerprint, decoder.
class MessageType {
  constructor(text) {
    const [, name, body] = /struct\s+(\w+)\s*\{(.*)\}/s.exec(text.replace(/\/\/.*/g, '')), constants = {};
    for (const [, line] of body.matchAll(/const\s+\w+\s+([^;]*);/g)) for (const [, key, value] of line.matchAll(/(\w+)\s*=\s*(-?\d+)/g)) constants[key] = Number(value);
    this.name = name;
    this.fields = [];
    for (const [, kind, names] of body.replace(/const[^;]*;/g, '').matchAll(/(\w+)\s+([^;]+);/g)) {
      for (const one of names.split(',')) {
        const [, field, brackets] = /\s*(\w+)((?:\[\w+\])*)/.exec(one), dims = [...brackets.matchAll(/\[(\w+)\]/g)].map(([, d]) => d);
        this.fields.push({ name: field, kind, dims: dims.map((d) => (/^\d+$/.test(d) ? Number(d) : constants[d] ?? d)) });
      }
    }
    this.fingerprint = fingerprintOf(this.fields);
  }

  // Decodes a message after its fingerprint. RangeError: too short.
  decode(view, begin) {
    const message = {};
    let at = begin;
    for (const { name, kind, dims } of this.fields) {
      const count = dims.reduce((n, d) => n * (typeof d === 'number' ? d : message[d]), 1);
      if (kind === 'string') {
        const length = view.getInt32(at);
        message[name] = new TextDecoder().decode(new Uint8Array(view.buffer, view.byteOffset + at + 4, length - 1));
        at += 4 + length;
        continue;
      }
      if (count < 0 || count * WIDTH[kind] > view.byteLength - at) throw new RangeError(`${name}: ${count} values are not there`);
      const values = Array.from({ length: count }, (_, i) => READ[kind](view, at + i * WIDTH[kind]));
      at += count * WIDTH[kind];
      message[name] = dims.length ? values : values[0];
    }
    return message;
  }
}

// LCM's hash of a type: names, kinds and dimensions of its members.
function fingerprintOf(fields) {
  const signed = (v) => BigInt.asIntN(64, v);
  let hash = 0x12345678n;
  const add = (byte) => { hash = signed(signed((hash << 8n) ^ (hash >> 55n)) + byte); };
  const word = (text) => { add(BigInt(text.length)); for (const c of text) add(BigInt(c.charCodeAt(0))); };
  for (const { name, kind, dims } of fields) {
    word(name);
    word(kind);
    add(BigInt(dims.length));
    for (const d of dims) { add(typeof d === 'number' ? 0n : 1n); word(String(d)); }
  }
  const bits = BigInt.asUintN(64, hash);
  return BigInt.asUintN(64, (bits << 1n) + (bits >> 63n));
}

const types = new Map(definitions.map((text) => new MessageType(text)).map((type) => [type.fingerprint, type]));

// Returns {channel: [{utime_us, type, message}]} of a log's bytes, in the log's order. Messages of other types are left out and counted in `skipped`,
// so are bytes between events; a log that ends within an event gives what is complete. Throws if it has no event.
export function readLog(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength), channels = {};
  let at = 0, skipped = 0, events = 0;
  while (at + 28 <= view.byteLength) {
    if (view.getUint32(at) !== SYNC) { at++; continue; }
    const name = view.getInt32(at + 20), size = view.getInt32(at + 24), end = at + 28 + name + size;
    if (name < 0 || size < 0 || end > view.byteLength) { at += 4; continue; }
    const utime_us = Number(view.getBigInt64(at + 12)), begin = at + 28 + name;
    const channel = new TextDecoder().decode(new Uint8Array(view.buffer, view.byteOffset + at + 28, name));
    const type = size >= 8 ? types.get(view.getBigUint64(begin)) : null;
    events++;
    at = end;
    try {
      const message = type.decode(new DataView(view.buffer, view.byteOffset + begin + 8, size - 8), 0);
      (channels[channel] ??= []).push({ utime_us, type: type.name, message });
    } catch {
      skipped++;
    }
  }
  if (!events) throw new TensormassError('no LCM event in this file; give a log of tm-sim --record or lcm-logger', 'TM_ERR_FILE');
  return { channels, skipped };
}
