// What the reader chose on a page, kept in this browser and written into the address: a link shows the same.

import { Preference } from './preference.svelte';
import { route } from './route.svelte';

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
