/**
 * The page's entry point.
 *
 * @module
 */

import { CaptureCameras } from "./controls/capture_cameras.js";
import { listenForFiles } from "./controls/drop.js";
import { PointerControls } from "./controls/pointer.js";
import { connectToolbar } from "./controls/toolbar.js";
import { PointRenderer } from "./drawing/point_renderer.js";
import { Renderer } from "./drawing/renderer.js";
import { SceneView } from "./drawing/scene_view.js";
import { element } from "./element.js";
import { TOO_OPAQUE } from "./formats/antialiased.js";
import { fetchScene, readScene } from "./formats/scene_file.js";
import { throttled } from "./live/throttle.js";
import { LiveRun } from "./live/run.js";
import { whileLoading } from "./messages/loading.js";
import { hideMessage, showMessage, showPreviews, showWithoutGpu } from "./messages/messages.js";
import { sizeOf } from "./size_text.js";

/** Default up direction, for cameras whose y axis points down. */
const USUAL_UP = [0, -1, 0];

async function start() {
    const canvas = element("canvas");
    const open = () => Renderer.open(canvas, showMessage);
    // Shaders are compiled while the scene loads.
    const opening = open();
    opening.catch(() => {});
    const viewer = await fetchViewer();
    showTitle(viewer.title);
    const points = new PointRenderer(element("points"));
    const view = new SceneView(canvas, points, {
        onStatistics: showStatistics,
        onNote: showNote,
        onFault: showMessage,
    });
    const cameras = new CaptureCameras(view);
    new PointerControls(canvas, view.camera, () => cameras.stopComparing());
    connectToolbar(view, cameras, { onFault: showMessage });
    listenForFiles((file) => openFile(file, view, cameras));
    view.setBackground(viewer.background);
    cameras.setViews(viewer);
    if (viewer.live) {
        follow(view, cameras);
    }
    const loading = viewer.scene && load(viewer, view, cameras);
    await view.busyUntil(Promise.all([drawOnGpu(opening, open, viewer, view), loading]));
}

function showTitle(title) {
    document.title = `${title} – PocketGS`;
    element("title").textContent = title;
}

async function fetchViewer() {
    const response = await fetch("viewer.json");
    if (!response.ok) {
        throw new Error(`viewer.json: the server answers ${response.status}`);
    }
    return response.json();
}

async function drawOnGpu(opening, open, viewer, view) {
    let renderer;
    try {
        renderer = await opening;
    } catch (error) {
        view.renderer.stayWithPoints();
        showWithoutGpu(error, viewer);
        return;
    }
    await view.renderer.useGpu(renderer, open);
}

async function load({ scene, title, up }, view, cameras) {
    const claim = view.beginOpening();
    const showPart = (gaussians, count) => {
        if (view.renderer.showPart(gaussians, count)) {
            cameras.frameArriving(gaussians, up, count);
        }
    };
    const onPart = throttled(showPart, () => view.pauseBetweenParts);
    const read = (onProgress) => fetchScene(scene, onProgress, onPart);
    try {
        const gaussians = await whileLoading(title, read);
        if (claim()) {
            warnOf(gaussians, title);
            await showScene(gaussians, up, view, cameras);
        }
    } catch (error) {
        if (claim()) {
            view.renderer.stayWithPoints();
        }
        showMessage(error.message);
    }
}

async function showScene(gaussians, up, view, cameras) {
    cameras.frameArriving(gaussians, up);
    await view.setScene(gaussians);
}

function warnOf({ isAntialiased }, name) {
    if (isAntialiased) {
        showMessage(`${name}: ${TOO_OPAQUE}`);
    }
}

async function openFile(file, view, cameras) {
    hideMessage();
    const claim = view.beginOpening();
    const read = (onProgress) => readScene(file.name, file.stream(), file.size, onProgress);
    try {
        const gaussians = await whileLoading(file.name, read);
        if (claim()) {
            cameras.frame(gaussians, USUAL_UP);
            warnOf(gaussians, file.name);
            await view.setScene(gaussians);
            showTitle(file.name);
        }
    } catch (error) {
        showMessage(error.message);
    }
}

function follow(view, cameras) {
    const claim = view.beginOpening();
    new LiveRun({
        onScene: async (gaussians) => {
            if (claim()) {
                await showScene(gaussians, USUAL_UP, view, cameras);
            }
        },
        onViewer: (viewer) => {
            if (claim()) {
                view.setBackground(viewer.background);
                cameras.setViews(viewer);
            }
            showPreviews(viewer.previews);
        },
        onResult: () => {
            if (claim()) {
                location.reload();
            }
        },
        onFault: showMessage,
    });
}

function showStatistics({ count, compositor, bytes, milliseconds }) {
    const parts = [`${count.toLocaleString("en")} splats`, compositor, bytes && sizeOf(bytes), timeOf(milliseconds)];
    element("stats").textContent = parts.filter(Boolean).join(" · ");
}

function showNote(text) {
    element("note").textContent = text;
}

function timeOf(milliseconds) {
    if (milliseconds >= 1000) {
        return `${(milliseconds / 1000).toFixed(1)}\u00a0s`;
    }
    return `${milliseconds < 10 ? milliseconds.toFixed(1) : Math.round(milliseconds)}\u00a0ms`;
}

start().catch((error) => showMessage(error.message));
