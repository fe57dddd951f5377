// Creates objects of the library from their definitions.
import { TensormassError } from './runtime.js';

// Calls a function that creates an object, and returns the object's address.
export function created(library, name, ...given) {
  const place = library.newArray([0], 'pointer');
  try {
    library.checked(name, ...given, place);
    return library.view(place, 1, 'pointer')[0];
  } finally {
    library.free(place);
  }
}

// Sets fields of a definition by name.
export function fill(definition, options) {
  for (const [name, value] of Object.entries(options)) {
    if (!(name in definition)) throw new TensormassError(`option "${name}" is not known; use one of ${Object.keys(definition.toObject()).join(', ')}`);
    definition[name] = value;
  }
  return definition;
}
