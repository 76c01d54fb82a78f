// What the reader chose on a page, kept in this browser: the layout is as it was left.

import { route } from './route.svelte';
const PREFIX = 'voltwall.';

/** A value that survives a reload; one that no longer fits `allowed` falls back to `first`. */
export class Preference<T extends string | number | boolean> {
  private current = $state() as T;

  constructor(
    private readonly name: string,
    first: T,
    allowed: (value: T) => boolean = () => true,
  ) {
    this.current = first;
    try {
      const stored: unknown = JSON.parse(localStorage.getItem(PREFIX + name) ?? 'null');
      if (typeof stored === typeof first && allowed(stored as T)) this.current = stored as T;
    } catch {
      // not ours: the first value stands
    }
  }

  get value(): T {
    return this.current;
  }

  set value(value: T) {
    this.current = value;
    localStorage.setItem(PREFIX + this.name, JSON.stringify(value));
  }
}

// What the reader chose on a page, kept in this browser and written into the address: a link shows the same.
export class SharedChoice<T extends string | number> {
  private readonly kept: Preference<T>;

  constructor(
    name: string,
    private readonly key: string, // in the address
    private readonly allowed: readonly T[], // the first one stands until another is chosen
  ) {
    this.kept = new Preference<T>(name, allowed[0]!, (value) => allowed.includes(value));
  }

  get value(): T {
    const linked = route.here.query.get(this.key);
    return this.allowed.find((each) => String(each) === linked) ?? this.kept.value;
  }

  set value(value: T) {
    this.kept.value = value;
    route.note({ [this.key]: String(value) });
  }
}
