// What the reader chose on a page, kept in this browser: the layout is as it was left.

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
