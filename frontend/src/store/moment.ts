// Where the moment of an event is looked at.

import type { BoxList, LogEvent, Session } from '../link/types';

const BOX_WITHIN_S = 60; // a box is written that long after its trip

/** The address of the moment: of its black box, or in its recording; empty where there is neither. */
export function momentOf(
  e: Pick<LogEvent, 'code' | 'cell' | 'time'>,
  boxes: readonly Pick<BoxList['boxes'][number], 'id' | 'cell' | 'time'>[], // newest first
  sessions: readonly Pick<Session, 'id' | 'started' | 'ended' | 'duration_s' | 'recording'>[],
): string {
  if (e.code === 'blackbox') {
    const box = boxes.find((b) => b.cell === e.cell && b.time <= e.time && e.time - b.time < BOX_WITHIN_S);
    return box ? `#/sessions/box/${encodeURIComponent(box.id)}` : '#/sessions/boxes';
  }
  const found = sessions.find(
    (s) =>
      s.started <= e.time &&
      e.time <= (s.recording ? Infinity : (s.ended ?? s.started + (s.duration_s ?? 0))),
  );
  const cell = e.cell === null ? '' : `&cell=${e.cell}`;
  return found ? `#/sessions/${encodeURIComponent(found.id)}?at=${e.time.toFixed(3)}${cell}` : '';
}
