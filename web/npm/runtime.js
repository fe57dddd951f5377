// Access to the library in WebAssembly: memory, structs by name, calls, errors.
import { structs, functions, constants } from './bindings.js';
import { hasSimd } from './vectors.js';

export { constants, hasSimd };

// An error that a function of the library returned: what is wrong; what to do.
export class TensormassError extends Error {
  // status: its name in C ("TM_ERR_MESH"); entity: index of the invalid vertex, tetrahedron or region, -1 if none.
  constructor(message, status = 'TM_ERR_ARGUMENT', entity = -1) {
    super(message);
    this.name = 'TensormassError';
    this.status = status;
    this.entity = entity;
  }
}

const STATUS = Object.fromEntries(Object.entries(constants).filter(([name]) => /^TM_(OK|ERR_\w+)$/.test(name)).map(([name, value]) => [value, name]));
const SIZE = { bool: 1, char: 1, i8: 1, u8: 1, i16: 2, u16: 2, i32: 4, u32: 4, i64: 8, u64: 8, f32: 4, f64: 8, text: 4, pointer: 4 };
const ARRAY = {
  bool: Uint8Array, char: Uint8Array, i8: Int8Array, u8: Uint8Array, i16: Int16Array, u16: Uint16Array, i32: Int32Array, u32: Uint32Array,
  i64: BigInt64Array, u64: BigUint64Array, f32: Float32Array, f64: Float64Array, text: Uint32Array, pointer: Uint32Array,
};
const freed = new FinalizationRegistry((release) => release());

async function bytesOf(name) {
  const url = new URL(name, import.meta.url);
  if (url.protocol !== 'file:' || typeof process === 'undefined') return undefined; // the module fetches it
  const { readFile } = await import('node:fs/promises');
  return readFile(url);
}

// Loads the library. form: "simd", "plain" (the reference, bit-identical to the native build's plain form), or "best".
// wasmBinary: the bytes of FORM.wasm, or wasmModule: compiled from them, if they were loaded elsewhere.
export async function load({ form = 'best', wasmBinary, wasmModule } = {}) {
  const chosen = form === 'best' ? (hasSimd() ? 'simd' : 'plain') : form;
  if (!['simd', 'plain'].includes(chosen)) throw new TensormassError(`form "${form}" is not known; use best, simd or plain`);
  const factory = chosen === 'simd' ? (await import('./simd.js')).default : (await import('./plain.js')).default;
  if (wasmModule) {
    const instantiateWasm = (imports, done) => { WebAssembly.instantiate(wasmModule, imports).then((instance) => done(instance, wasmModule)); return {}; };
    return new Library(await factory({ instantiateWasm, locateFile: (file) => new URL(file, import.meta.url).href }), chosen);
  }
  const binary = wasmBinary ?? (await bytesOf(`${chosen}.wasm`));
  const module = await factory({ ...(binary ? { wasmBinary: binary } : {}), locateFile: (file) => new URL(file, import.meta.url).href });
  return new Library(module, chosen);
}

// The loaded library. Only one thread may use it; a worker loads its own.
export class Library {
  constructor(module, form) {
    this.module = module;
    this.form = form;
    this.fs = module.FS;
    this.classes = new Map();
    this.broken = null;
    const handler = module.addFunction((name, sentence) => { this.broken ??= `${this.text(name)}: ${this.text(sentence)}`; }, 'viii');
    this.call('tm_set_contract_handler', handler, 0);
  }

  // --- memory ---

  get bytes() { return this.module.HEAPU8; }
  get bytesInUse() { return Number(this.call('tm_memory_in_use')); }
  // Bytes of all blocks that are allocated, also those of structs and arrays that were made here.
  get bytesUsed() {
    const place = this.allocate(40);
    this.module._mallinfo(place);
    const used = this.view(place, 10, 'i32')[7];
    this.free(place);
    return used;
  }

  allocate(size) {
    const address = this.module._malloc(Math.max(1, size));
    if (!address) throw new TensormassError(`${size} bytes cannot be allocated; use a smaller mesh`, 'TM_ERR_MEMORY');
    return address;
  }

  free(address) { this.module._free(address); }
  text(address) { return address ? this.module.UTF8ToString(address) : ''; }

  newText(value) {
    const size = this.module.lengthBytesUTF8(value) + 1, address = this.allocate(size);
    this.module.stringToUTF8(value, address, size);
    return address;
  }

  // Memory of the library as a typed array, without a copy. Valid until the library allocates: get it again after a call.
  view(address, count, kind = 'f64') { return new ARRAY[kind](this.bytes.buffer, address, address ? count : 0); }

  // Copies numbers into new memory of the library.
  newArray(values, kind = 'f64') {
    const address = this.allocate(values.length * SIZE[kind]);
    new ARRAY[kind](this.bytes.buffer, address, values.length).set(values);
    return address;
  }

  // --- structs ---

  classOf(name) {
    if (!this.classes.has(name)) this.classes.set(name, structClass(this, name, structs[name]));
    return this.classes.get(name);
  }

  // Returns a view of a struct at an address, with a property for each field.
  at(name, address) { return new (this.classOf(name))(address); }

  // Returns a zeroed struct that is freed with the object, or by free().
  make(name) {
    const size = structs[name].size, address = this.allocate(size);
    this.bytes.fill(0, address, address + size);
    return this.owned(name, address);
  }

  owned(name, address) {
    const made = this.at(name, address), module = this.module;
    let alive = true;
    const release = () => { if (alive) { alive = false; module._free(address); } };
    freed.register(made, release);
    Object.defineProperty(made, 'free', { value: release });
    return made;
  }

  // Returns n structs in a row, as an array of views, and frees them with the first.
  makeArray(name, count) {
    const size = structs[name].size, address = this.allocate(size * Math.max(1, count));
    this.bytes.fill(0, address, address + size * count);
    const first = this.owned(name, address);
    return Array.from({ length: count }, (_, i) => (i ? this.at(name, address + i * size) : first));
  }

  // --- calls ---

  // Calls a function by its name in C. Strings are passed as text, structs by their address, typed arrays as copies. Structs are returned as owned.
  call(name, ...values) {
    const [result, kinds] = functions[name] ?? (() => { throw new TensormassError(`${name} is not a function of the library; see bindings.js`); })();
    const temporary = [];
    const given = values.map((value, i) => this.argument(value, kinds[i], temporary));
    const sized = structs[result];
    const out = sized ? this.allocate(sized.size) : 0;
    let back;
    try {
      back = this.module[`_${name}`](...(sized ? [out, ...given] : given));
    } finally {
      temporary.forEach((address) => this.free(address));
    }
    if (this.broken) {
      const sentence = this.broken;
      this.broken = null;
      throw new TensormassError(sentence);
    }
    if (sized) return this.owned(result, out);
    return { bool: () => back !== 0, u64: () => BigInt.asUintN(64, back), u32: () => back >>> 0, text: () => this.text(back) }[result]?.() ?? back;
  }

  argument(value, kind, temporary) {
    if (typeof value === 'string') {
      temporary.push(this.newText(value));
      return temporary.at(-1);
    }
    if (ArrayBuffer.isView(value)) {
      temporary.push(this.allocate(value.byteLength));
      this.bytes.set(new Uint8Array(value.buffer, value.byteOffset, value.byteLength), temporary.at(-1));
      return temporary.at(-1);
    }
    if (value === null || value === undefined) return 0;
    if (typeof value === 'object') return value.address;
    return kind === 'i64' || kind === 'u64' ? BigInt(value) : value;
  }

  // Calls a set-up function, whose last argument is the error, and throws that error.
  checked(name, ...values) {
    const error = this.make('tm_error');
    try {
      const status = this.call(name, ...values, error);
      if (status !== constants.TM_OK) throw new TensormassError(error.message || STATUS[status], STATUS[status], error.entity);
    } finally {
      error.free();
    }
  }

  statusName(status) { return STATUS[status] ?? String(status); }
}

// The class of one struct's views: a property a field. Numbers are read and written; arrays are typed arrays; nested structs are views.
function structClass(library, name, { size, fields }) {
  class Struct {
    constructor(address) { Object.defineProperty(this, 'address', { value: address }); }
    // A plain object with a copy of the fields.
    toObject() {
      return Object.fromEntries(Object.keys(fields).map((f) => {
        const value = this[f];
        return [f, ArrayBuffer.isView(value) ? Array.from(value) : value?.toObject?.() ?? value];
      }));
    }
  }
  Object.defineProperty(Struct, 'name', { value: name });
  Struct.size = size;
  for (const [field, [offset, kind, count]] of Object.entries(fields)) {
    Object.defineProperty(Struct.prototype, field, { enumerable: true, ...accessor(library, offset, kind, count) });
  }
  return Struct;
}

function accessor(library, offset, kind, count) {
  if (structs[kind]) {
    const step = structs[kind].size;
    return { get() { return count ? Array.from({ length: count }, (_, i) => library.at(kind, this.address + offset + i * step)) : library.at(kind, this.address + offset); } };
  }
  if (kind === 'char' && count) return { get() { return library.text(this.address + offset); } };
  if (count) {
    return {
      get() { return library.view(this.address + offset, count, kind); },
      set(values) { library.view(this.address + offset, count, kind).set(values); },
    };
  }
  const one = (self) => library.view(self.address + offset, 1, kind);
  return {
    get() { const v = one(this)[0]; return kind === 'bool' ? v !== 0 : kind === 'text' ? library.text(v) : v; },
    set(value) { one(this)[0] = kind === 'i64' || kind === 'u64' ? BigInt(value) : Number(value); },
  };
}
