import { describe, expect, it } from 'vitest';
import { strength, surprises } from '../src/store/password_strength';

describe('what a new password is worth', () => {
  it('is nothing below what the service takes', () => {
    expect(strength('')).toBe('short');
    expect(strength('x9$Kq2!vB7m')).toBe('short');
  });

  it('counts neither repetitions nor rows', () => {
    expect(surprises('aaaaaaaa')).toBe(1);
    expect(surprises('12345678')).toBe(1);
    expect(surprises('87654321')).toBe(1);
    expect(surprises('tapetapetape')).toBe(6);
    for (const password of ['aaaaaaaaaaaaaaaa', '123456789012', 'passpasspasspass', 'voltvoltvolt']) {
      expect(strength(password)).toBe('weak');
    }
  });

  it('is good where it is long and new', () => {
    expect(strength('x9$Kq2!vB7mW')).toBe('fair');
    expect(strength('correct horse battery staple')).toBe('strong');
    expect(strength('åtte våte katter på taket')).toBe('strong');
  });

  it('counts characters, not their codes', () => {
    expect(strength('🔋🐎🔋🐎🔋')).toBe('short');
    expect(strength('電池車両走行試験計画安全確認良')).toBe('fair');
  });

  it('never falls when something is added', () => {
    const password = 'wet cats on the roof of 12 garages';
    const worth = [...password].map((_, i) => surprises(password.slice(0, i + 1)));
    expect(worth).toEqual([...worth].sort((a, b) => a - b));
  });
});
