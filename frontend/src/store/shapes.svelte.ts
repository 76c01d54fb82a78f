// Which shape the cells of a page are counted in: the battery that is measured now, or that of a recorded session.

import { Shape, type Outline } from './shape';

const UNKNOWN = new Shape({ segments: [] });

class Shapes {
  /** Of what is measured or replayed now, for what stands beside every page too. */
  live = $state.raw(UNKNOWN);
  private session = $state.raw<Shape | null>(null);

  /** Of what the page shows. */
  get here(): Shape {
    return this.session ?? this.live;
  }

  /** Show a recorded battery until the returned closure is called. */
  show(outline: Outline): () => void {
    const shape = (this.session = new Shape(outline));
    return () => {
      if (this.session === shape) this.session = null;
    };
  }
}

export const shapes = new Shapes();
