// Connects feed, model and views, and lets ages grow by the browser's own clock.

import { Alarm } from "./alarm.js";
import { Untold, aloud } from "./calls.js";
import { showFacts, showText } from "./elements.js";
import { Feed } from "./feed.js";
import * as model from "./model.js";
import { leaveEmptyField, listenToKeys } from "./keys.js";
import { joined } from "./plots.js";
import { Recordings } from "./recordings.js";
import { poster, say } from "./sending.js";
import { Settings } from "./settings.js";
import * as views from "./views.js";

const send = poster("the rover does not answer. See what it says at the top.");
// What /shown-calls.json changes with.
const opened = (content) => [content?.state?.open?.id, content?.state?.open?.stage, content?.state?.open?.holding, content?.state?.reasons, content?.incidents];
const now = () => performance.now() / 1000;
const recordings = new Recordings(document.getElementById("recordings"), say);
const picture = document.getElementById("picture");
const settings = new Settings(document.getElementById("settings"), say, picture);
const untold = new Untold();
const alarm = new Alarm(document.getElementById("alarm"));
let news = null;
let connection = "";
let told = { calls: [], names: [], alone: [] }; // of /shown-calls.json
let points = [];
let offset = 0; // this clock less the rover's
let seen = null; // the picture that is shown: {frame, age, receivedAt}
let coming = null; // the one that is being loaded
let next = null; // the newest one that was announced meanwhile

function load(announced) {
  coming = announced;
  picture.src = `/live.jpg?frame=${announced.frame}`;
}

function loaded(shown) {
  if (shown) {
    seen = coming;
    picture.hidden = false;
    views.showFromAbove(seen);
  }
  coming = null;
  if (next) load(next);
  next = null;
  tick();
}

function readFiles() {
  feed.readFiles();
  recordings.refresh();
}

picture.addEventListener("load", () => loaded(true));
picture.addEventListener("error", () => loaded(false));

// A computer that sleeps stops the clock of `now`, and what is shown would look younger than it is.
let ahead = Date.now() / 1000 - now();

function tick() {
  const slept = Date.now() / 1000 - now() - ahead;
  if (Math.abs(slept) > 1) {
    ahead += slept;
    for (const old of [news, seen, coming, next]) if (old) old.receivedAt -= Math.max(0, slept);
  }
  const state = model.overview(news, now(), connection);
  views.showState(state, told.calls.filter((call) => call.open).length);
  views.showPictureNote(model.pictureNote(seen, now(), state.stale));
  const time = now() - offset;
  if (!news) return;
  views.showAhead(news, points, time);
  views.showCalls({ calls: told.calls, names: told.names, given: news.state?.given, words: model.words(news) }, time);
  views.showAlone(told.alone);
  views.showLastMinute(told.last_minute);
}

const feed = new Feed((kind, content, late) => {
  switch (kind) {
    case "connection":
      connection = content;
      settings.connection(content);
      break;
    case "ground":
      views.showGround(content.lines);
      break;
    case "points":
      points = joined(points.filter(([at]) => at < content.points[0][0]), content.points);
      break;
    case "news":
      if (!news) {
        views.begin(content.answers ? send : null);
        recordings.begin(content.answers ? send : null);
        settings.begin(content.answers);
        if (content.answers) document.getElementById("about").before(keys);
      }
      if (JSON.stringify(opened(news)) !== JSON.stringify(opened(content))) readFiles();
      news = { ...content, receivedAt: now() - late };
      offset = news.receivedAt - content.clock;
      showFacts("now", model.facts(news));
      showFacts("computer", model.computer(news));
      views.showPlace(news);
      recordings.show(news.status?.recording);
      settings.show(news.status?.set_by_ground);
      views.showChecks(model.checks(news));
      showText("about", `AnyTraverse companion ${news.status?.version ?? ""}. ${news.answers ? "Calls can be answered here." : "This page only shows: answer calls from a ground station, or set [web] token."}`);
      break;
    case "picture": {
      const announced = { ...content, receivedAt: now() - late };
      if (coming) next = announced;
      else load(announced);
      break;
    }
    case "answered":
      readFiles();
      break;
    case "calls":
      told = content;
      for (const call of untold.take(told.calls)) {
        alarm.ring(aloud(call), call.key);
        leaveEmptyField();
      }
      break;
    case "log":
      views.showLog(model.logLines(content));
  }
  tick();
}, () => alarm.on);
const keys = listenToKeys(views.firstCard);
setInterval(tick, 250);
document.addEventListener("visibilitychange", tick);
