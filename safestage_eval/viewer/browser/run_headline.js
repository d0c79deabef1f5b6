// One line over the whole run: how many reached the goal, and how many of them unsafely.

import { byId, element } from "./elements.js";

const counted = (number, one, several) => `${number.toLocaleString("en")} ${number === 1 ? one : several}`;

/** Write the line of a table of episodes. */
export function writeHeadline(table) {
  const { unsafe, safe, open } = table.outcomes();
  const undecided = open ? `, ${open.toLocaleString("en")} undecided` : "";
  if (!table.goals) {
    return byId("run-line").replaceChildren(element("b", {}, `${counted(unsafe, "episode breaks", "episodes break")} a rule`),
      `, ${safe.toLocaleString("en")} safe${undecided}`);
  }
  const reached = table.episodes.success.filter((success) => success === true).length;
  return byId("run-line").replaceChildren(`${reached.toLocaleString("en")} reached the goal, `,
    element("b", {}, `${unsafe.toLocaleString("en")} of them unsafe`), undecided);
}
