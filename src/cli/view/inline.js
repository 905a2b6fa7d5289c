
// A page that holds its scene.
const inlineScene = JSON.parse($("scene").textContent);
const packed = Uint8Array.from(atob($("numbers").textContent.trim()), (c) => c.charCodeAt(0));
$("numbers").textContent = "";
showScene(inlineScene, packed).catch((e) => fail(e.message));
