"use strict";
const socket = new WebSocket(`ws://${location.host}/live`);
const sections = {};
socket.onmessage = (event) => {
  Object.assign(sections, JSON.parse(event.data).sections);
  document.getElementById("state").textContent = JSON.stringify(sections, null, 1);
};
