// SafestageReplay for scripts that are no modules: the labelling page.

import { SafestageReplay } from "./replay.js";

globalThis.SafestageReplay = SafestageReplay;
