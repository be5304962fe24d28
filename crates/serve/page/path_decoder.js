// Decodes the chunks of the path.
//
// Invariant: a vertex has 16 bytes: x, y, z as f32 in mm relative to the origin, and a u32 with the record in the low
// 30 bits and the kind of the segment that ends there in the high two. Place 0 is kept free for the vertex before.

export const VERTEX_BYTES = 16;
export const KIND_SHIFT = 30;
export const RECORD_MASK = 0x3fffffff;
const HEADER_BYTES = 28;

/** Decodes a binary message. Returns null for a kind or version that is not known. */
export function decodeChunk(message) {
  const head = new DataView(message);
  if (message.byteLength < HEADER_BYTES || head.getUint8(0) !== 1 || head.getUint8(1) !== 1) return null;
  if (head.getUint8(3) !== 1) return null;
  const count = head.getUint32(12, true);
  return {
    level: head.getUint8(2),
    path: head.getUint32(4, true),
    first: head.getUint32(8, true),
    count,
    originMm: [16, 20, 24].map(offset => head.getInt32(offset, true) / 1000),
    data: unpackVertices(new Uint8Array(message, HEADER_BYTES), count),
  };
}

function unpackVertices(bytes, count) {
  const data = new ArrayBuffer((count + 1) * VERTEX_BYTES);
  const floats = new Float32Array(data),
    words = new Uint32Array(data);
  let place = 0,
    record = 0,
    x = 0,
    y = 0,
    z = 0;
  const next = () => {
    let byte = bytes[place++];
    if (byte < 128) return byte;
    let value = byte & 127,
      factor = 128;
    do {
      byte = bytes[place++];
      value += (byte & 127) * factor;
      factor *= 128;
    } while (byte > 127);
    return value;
  };
  const signed = value => (value % 2 ? -(value + 1) / 2 : value / 2);
  for (let index = 1; index <= count; index++) {
    const mark = next();
    record += Math.floor(mark / 4);
    x += signed(next());
    y += signed(next());
    z += signed(next());
    const at = index * 4;
    floats[at] = x / 1000;
    floats[at + 1] = y / 1000;
    floats[at + 2] = z / 1000;
    words[at + 3] = Math.min(record, RECORD_MASK) | ((mark % 4) << KIND_SHIFT);
  }
  return data;
}
