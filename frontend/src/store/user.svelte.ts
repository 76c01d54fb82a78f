// Who is reading, what they may do, and how they like their page.

import { get, post, Problem } from '../link/rest';
import type { Me } from '../link/types';
import { live } from './live.svelte';

export type ThemeName = 'dark' | 'light' | 'sun';
export const THEMES: readonly ThemeName[] = ['dark', 'light', 'sun'];

const THEME_KEY = 'voltwall.theme';

class User {
  me = $state.raw<Me | null>(null);
  theme = $state<ThemeName>('dark');

  isEngineer = $derived(this.me?.role === 'engineer' || this.me?.role === 'chief');
  mustLogIn = $derived(this.me !== null && this.me.password_required && this.me.role === null);

  /** Whether something can be changed now: by an engineer, while the service answers. */
  get mayWrite(): boolean {
    return this.isEngineer && live.answers;
  }

  async start(): Promise<void> {
    const preferred = matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark';
    const stored = localStorage.getItem(THEME_KEY);
    this.setTheme(THEMES.find((t) => t === stored) ?? preferred);
    await this.refresh();
  }

  async refresh(): Promise<void> {
    try {
      this.me = await get<Me>('me');
    } catch (error) {
      if (error instanceof Problem && error.status === 401) {
        this.me = { role: null, name: null, password_required: true, has_chief: false };
      }
    }
  }

  async logIn(name: string, password: string): Promise<void> {
    this.me = await post<Me>('login', { name, password });
    live.restart();
  }

  async logOut(): Promise<void> {
    await post('logout');
    await this.refresh();
    live.restart();
  }

  nextTheme(): void {
    this.setTheme(THEMES[(THEMES.indexOf(this.theme) + 1) % THEMES.length]!);
  }

  setTheme(theme: ThemeName): void {
    this.theme = theme;
    document.documentElement.dataset['theme'] = theme;
    localStorage.setItem(THEME_KEY, theme);
  }
}

export const user = new User();
