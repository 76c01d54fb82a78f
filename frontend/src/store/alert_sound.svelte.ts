// Calls for a person: a sound that can be muted for a time, and a notification of the browser if it may.
// Alarms that wait for an acknowledgement sound; those that were there at the first snapshot do so too.

import type { Alarm, Severity } from '../link/types';
import { clock } from '../format';
import { chosen, t, messageText } from '../words/words.svelte';
import { openAlarms } from './alarms.svelte';
import { Preference } from './preference.svelte';
import { live } from './live.svelte';
import { shapes } from './shape.svelte';

export const MUTES_MIN = [5, 30, 120] as const;

const EVERY_MS = 1000;
const REPEAT_S: Record<Severity, number> = { trip: 4, warning: 20, watch: Infinity };
const TONES: Record<Severity, readonly [hz: number, at: number][]> = {
  trip: [
    [880, 0],
    [660, 0.18],
    [880, 0.36],
  ],
  warning: [
    [660, 0],
    [660, 0.25],
  ],
  watch: [],
};
const TONE_S = 0.14;
const MOST_SPOKEN = 3;
const VOICES: Record<string, string> = { en: 'en-GB', nb: 'nb-NO' };
const LOUDNESS = 0.25;

/** The alarms that may sound: active, unseen, worse than "watch"; worst first. */
export const audibleAlarms = (alarms: readonly Alarm[]): Alarm[] =>
  alarms.filter((a) => a.active && !a.acknowledged_by && a.severity !== 'watch');

/** The alarms that a voice names now: new ones, worst first, no more than can be listened to. */
export const spokenAlarms = (alarms: readonly Alarm[], announced: ReadonlySet<number>): Alarm[] =>
  alarms.filter((a) => !announced.has(a.id)).slice(0, MOST_SPOKEN);

/** Whether the worst of `alarms` shall sound now: a new one at once, an old one after its pause. */
export function isDue(alarms: readonly Alarm[], announced: ReadonlySet<number>, silentS: number): boolean {
  const worst = alarms[0];
  if (!worst) return false;
  return alarms.some((a) => !announced.has(a.id)) || silentS >= REPEAT_S[worst.severity];
}

class AlertSound {
  readonly sound = new Preference<boolean>('sound', true);
  readonly speak = new Preference<boolean>('speak', false);
  readonly canSpeak = typeof speechSynthesis !== 'undefined';
  readonly notify = new Preference<boolean>('notify', false);
  private readonly until = new Preference<number>('mutedUntil', 0); // unix seconds
  blocked = $state(false); // the browser waits for a click or a key before it lets a page sound
  permission = $state(typeof Notification === 'undefined' ? 'missing' : Notification.permission);
  private audio: AudioContext | null = null;
  private readonly announced = new Set<number>();
  private readonly shown = new Set<number>();
  private soundedAt = -Infinity;

  /** Unix seconds at which the sound comes back, null while it is not muted. */
  get mutedUntil(): number | null {
    void live.now; // ends automatically
    return this.until.value > Date.now() / 1000 ? this.until.value : null;
  }

  get muteText(): string {
    if (!this.sound.value) return t('common.sound_off');
    return this.mutedUntil === null
      ? t('common.sound_on')
      : t('common.muted_until', { time: clock(this.mutedUntil) });
  }

  mute(minutes: number): void {
    this.until.value = minutes > 0 ? Date.now() / 1000 + minutes * 60 : 0;
  }

  start(): void {
    window.setInterval(() => this.look(), EVERY_MS);
    for (const gesture of ['pointerdown', 'keydown']) {
      addEventListener(gesture, () => void this.wake(), { capture: true });
    }
  }

  /** Sound one alarm of a severity, so that the reader knows it and the volume. */
  async test(severity: Severity): Promise<void> {
    await this.wake();
    this.play(severity);
  }

  /** Let a voice name new alarms from now on; what it says first is that it does. */
  setSpeaking(on: boolean): void {
    this.speak.value = on;
    if (on) this.say(t('common.alarms_read_aloud'));
    else speechSynthesis.cancel();
  }

  private say(text: string): void {
    const words = new SpeechSynthesisUtterance(text);
    words.lang = VOICES[chosen.language] ?? chosen.language;
    speechSynthesis.speak(words);
  }

  private sayNew(alarms: readonly Alarm[]): void {
    const fresh = spokenAlarms(alarms, this.announced);
    if (fresh[0]?.severity === 'trip') speechSynthesis.cancel(); // a trip waits for no other sentence
    for (const alarm of fresh)
      this.say(`${t(`severity.${alarm.severity}`)}: ${messageText(alarm.message, shapes.live)}`);
  }

  async allowNotifications(on: boolean): Promise<void> {
    this.notify.value = on;
    if (on && typeof Notification !== 'undefined') this.permission = await Notification.requestPermission();
  }

  private async wake(): Promise<void> {
    if (!this.sound.value) return;
    this.audio ??= new AudioContext();
    if (this.audio.state === 'suspended') await this.audio.resume().catch(() => undefined);
    this.blocked = this.audio.state === 'suspended';
  }

  private look(): void {
    const alarms = audibleAlarms(openAlarms(live.snapshot));
    const now = performance.now() / 1000;
    if (alarms.length > 0 && this.sound.value && this.mutedUntil === null) {
      if (isDue(alarms, this.announced, now - this.soundedAt)) {
        this.soundedAt = now;
        if (this.audio?.state === 'running') this.play(alarms[0]!.severity);
        else this.blocked = true;
      }
    } else {
      this.blocked = false;
    }
    if (this.speak.value && this.canSpeak && this.mutedUntil === null) this.sayNew(alarms);
    for (const alarm of alarms) {
      this.announced.add(alarm.id);
      this.announce(alarm);
    }
  }

  private announce(alarm: Alarm): void {
    if (this.shown.has(alarm.id)) return;
    this.shown.add(alarm.id);
    if (!this.notify.value || this.permission !== 'granted' || !document.hidden) return;
    try {
      const note = new Notification(`Voltwall: ${t(`severity.${alarm.severity}`)}`, {
        body: messageText(alarm.message, shapes.live),
        tag: `alarm-${alarm.id}`,
        icon: './icon-192.png',
      });
      note.onclick = () => {
        window.focus();
        location.hash = '#/events';
      };
    } catch {
      // browsers on phones only let a service worker notify; the sound and the title remain
    }
  }

  private play(severity: Severity): void {
    const audio = this.audio;
    if (!audio) return;
    for (const [hz, at] of TONES[severity]) {
      const start = audio.currentTime + at;
      const tone = audio.createOscillator();
      const gain = audio.createGain();
      tone.frequency.value = hz;
      tone.type = 'square';
      gain.gain.setValueAtTime(0, start);
      gain.gain.linearRampToValueAtTime(LOUDNESS, start + 0.01);
      gain.gain.setValueAtTime(LOUDNESS, start + TONE_S - 0.02);
      gain.gain.linearRampToValueAtTime(0, start + TONE_S);
      tone.connect(gain).connect(audio.destination);
      tone.start(start);
      tone.stop(start + TONE_S);
    }
  }
}

export const alertSound = new AlertSound();
