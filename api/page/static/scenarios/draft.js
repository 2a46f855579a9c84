// What is edited and not stored yet: each place's draft outlasts a reload of its tab.
const KEY = "hrs-scenario:";
const LAST = "hrs-scenario-last"; // the place that was edited last

export function keep(place, draft) {
  // Whether there was room for it.
  try {
    sessionStorage.setItem(KEY + place, JSON.stringify(draft));
    sessionStorage.setItem(LAST, place);
    return true;
  } catch {
    return false;
  }
}

export function forget(place) {
  sessionStorage.removeItem(KEY + place);
  if (sessionStorage.getItem(LAST) === place) sessionStorage.removeItem(LAST);
}

export const last = () => sessionStorage.getItem(LAST);

export function kept(place) {
  try {
    return JSON.parse(sessionStorage.getItem(KEY + place));
  } catch {
    return null;
  }
}
