//! An open camera.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, anyhow, bail};
use heapless::Vec;
use libcamera::camera::ActiveCamera;
use libcamera::camera_manager::CameraManager;
use libcamera::control::{ControlEntry, ControlList, MergePolicy};
use libcamera::controls::SensorTimestamp;
use libcamera::framebuffer::{AsFrameBuffer, FrameMetadataStatus};
use libcamera::framebuffer_allocator::{FrameBuffer, FrameBufferAllocator};
use libcamera::request::{Request, RequestStatus, ReuseFlag};
use libcamera::stream::Stream;
use plumbline::config::Capture;

use super::inbox::{Inbox, REQUESTS_MAX};
use super::layout::{Layout, Samples};
use super::mapping::Mapping;
use super::setup::{self, Choice};
use super::stamp::Clocks;
use crate::source::Frame;
use crate::source::camera::{Counts, Device, Waited};
use crate::source::newest::Newest;
use crate::source::stamp::{Sequence, Stamp};

/// A running camera.
///
/// Fields are dropped in their order: the requests before the camera that they
/// belong to, and all of it before the manager, which must be the last.
pub struct Libcamera {
    /// The frame that was given.
    current: Option<Held>,
    waiting: Newest<Completed>,
    inbox: Arc<Inbox<Request>>,
    camera: ActiveCamera<'static>,
    stream: Stream,
    layout: Layout,
    /// The buffers' mappings; a request's cookie is the index of its mapping.
    mappings: Vec<Mapping, REQUESTS_MAX>,
    /// The luma of the current frame, if it had to be copied.
    luma: Box<[u8]>,
    sequence: Sequence,
    counts: Counts,
    _manager: CameraManager,
}

/// A request with a good frame.
struct Completed {
    request: Request,
    stamp: Stamp,
}

/// A frame that is being read.
struct Held {
    completed: Completed,
    /// Index of its mapping.
    buffer: usize,
    late: bool,
}

impl Libcamera {
    /// Takes the requests that were completed since, at most as many as there are: a
    /// camera that fills buffers faster than they are processed cannot hold up the loop.
    fn take_completed(&mut self) -> Result<(), String> {
        for _ in 0..REQUESTS_MAX {
            let Some(request) = self.inbox.pop() else { break };
            if request.status() == RequestStatus::Cancelled {
                return Err("the camera has cancelled its requests".into());
            }
            match self.judge(&request) {
                Some(stamp) => {
                    if let Some(oldest) = self.waiting.push(Completed { request, stamp }) {
                        self.counts.dropped += 1;
                        self.queue(oldest.request)?;
                    }
                }
                None => self.queue(request)?,
            }
        }
        Ok(())
    }

    /// The stamp of a good frame; counts the frames missing before it, and itself
    /// when it is damaged.
    fn judge(&mut self, request: &Request) -> Option<Stamp> {
        // Some pipelines fill in nothing; then the completed request must do.
        let metadata = request.buffer::<FrameBuffer>(&self.stream)?.metadata();
        let driver_ns = metadata.as_ref().map_or(0, |metadata| metadata.timestamp());
        if let Some(metadata) = metadata {
            self.counts.missed += self.sequence.missed_before(metadata.sequence());
            match metadata.status() {
                FrameMetadataStatus::Success => {}
                // A sensor that is starting gives frames that are not meant to be used.
                FrameMetadataStatus::Startup => return None,
                FrameMetadataStatus::Error | FrameMetadataStatus::Cancelled => {
                    self.counts.missed += 1;
                    return None;
                }
            }
        }
        // Checked first, because libcamera logs every query for a missing control.
        let controls = request.metadata();
        let sensor = if controls.contains(SensorTimestamp::ID) {
            controls.get::<SensorTimestamp>().ok()
        } else {
            None
        };
        let sensor_ns = sensor.and_then(|stamp| u64::try_from(stamp.0).ok());
        Some(Clocks::read().stamp(sensor_ns, driver_ns))
    }

    /// Gives a request back to the camera.
    fn queue(&self, mut request: Request) -> Result<(), String> {
        request.reuse(ReuseFlag::REUSE_BUFFERS);
        self.camera
            .queue_request(request)
            .map_err(|(_, error)| format!("the camera takes no more requests: {error}"))
    }

    /// Makes a completed frame the current one.
    fn hold(&mut self, completed: Completed) -> Result<(), String> {
        let mapping = usize::try_from(completed.request.cookie())
            .ok()
            .and_then(|buffer| Some((buffer, self.mappings.get(buffer)?)));
        let Some((buffer, mapping)) = mapping else {
            return Err("the camera has returned a request with an unknown buffer".into());
        };
        mapping.begin_read();
        self.layout.copy_luma(mapping.bytes(), &mut self.luma);
        let late = !self.waiting.is_empty();
        self.current = Some(Held { completed, buffer, late });
        Ok(())
    }

    fn release(&mut self) -> Result<(), String> {
        let Some(held) = self.current.take() else { return Ok(()) };
        self.mappings[held.buffer].end_read();
        self.queue(held.completed.request)
    }

    fn next(&mut self, until: Instant) -> Result<Waited, String> {
        self.release()?;
        loop {
            self.take_completed()?;
            if let Some(completed) = self.waiting.pop() {
                self.hold(completed)?;
                return Ok(Waited::Ready);
            }
            if self.inbox.is_disconnected() {
                return Err("the camera has been disconnected".into());
            }
            if !self.inbox.wait(until) {
                return Ok(Waited::Quiet);
            }
        }
    }
}

impl Device for Libcamera {
    fn open(capture: &Capture, size_px: (usize, usize)) -> Result<Self> {
        let samples = Samples::of(capture.pixel_format).with_context(|| {
            let format = capture.pixel_format;
            format!("capture.pixel_format: {format:?} is read with driver = \"v4l2\" only")
        })?;
        let manager = CameraManager::new().context("libcamera does not start")?;
        let Choice { camera, mut configuration } =
            setup::choose(&manager, capture, size_px, REQUESTS_MAX)?;
        let name = camera.id().to_owned();
        let mut camera = camera
            .acquire()
            .with_context(|| format!("the camera {name} is in use: stop the other program"))?;
        camera
            .configure(&mut configuration)
            .with_context(|| format!("the camera {name} refuses its configuration"))?;
        let chosen = configuration.get(0).context("the configuration has no stream")?;
        let stream = chosen.stream().context("the configuration's stream is not set up")?;
        let layout = Layout { size_px, stride_bytes: chosen.get_stride() as usize, samples };

        let luma = vec![0; layout.copied_bytes()].into_boxed_slice();
        let mut mappings = Vec::<Mapping, REQUESTS_MAX>::new();
        let mut requests = Vec::<Request, REQUESTS_MAX>::new();
        let buffers = FrameBufferAllocator::new(&camera)
            .alloc(&stream)
            .with_context(|| format!("the camera {name} has no memory for frames"))?;
        for (index, buffer) in buffers.into_iter().take(REQUESTS_MAX).enumerate() {
            let mapping = map_luma(&buffer)
                .with_context(|| format!("frame buffer {index} of {name} cannot be mapped"))?;
            layout.pixels(mapping.bytes(), &luma).map_err(|error| {
                anyhow!("frame buffer {index} of {name} does not hold a frame: {error}")
            })?;
            let mut request =
                camera.create_request(Some(index as u64)).context("libcamera gives no request")?;
            request.add_buffer(&stream, buffer).context("a request takes no frame buffer")?;
            // Some pipelines take their settings when they start, others only
            // with a request.
            if index == 0 {
                setup::set_controls(&camera, capture, request.controls_mut())?;
            }
            // There is room for as many as the loop runs.
            let _ = mappings.push(mapping);
            let _ = requests.push(request);
        }
        // One is tracked and two may wait: the camera needs one to fill.
        if requests.len() < 4 {
            bail!("the camera {name} has {} frame buffers, and needs 4", requests.len());
        }

        let inbox = Arc::new(Inbox::new());
        let completed = Arc::clone(&inbox);
        // The inbox has room for all requests.
        camera.on_request_completed(move |request| drop(completed.push(request)));
        let gone = Arc::clone(&inbox);
        camera.on_disconnected(move || gone.disconnect());
        let mut controls = ControlList::new();
        controls.merge(requests[0].controls(), MergePolicy::OverwriteExisting);
        camera
            .start(Some(&controls))
            .with_context(|| format!("the camera {name} does not start"))?;
        for request in requests {
            camera
                .queue_request(request)
                .map_err(|(_, error)| anyhow!("the camera {name} takes no requests: {error}"))?;
        }
        log::info!("camera {name}: {:?} {}x{}", chosen.get_pixel_format(), size_px.0, size_px.1);
        Ok(Self {
            current: None,
            waiting: Newest::new(),
            inbox,
            camera,
            stream,
            layout,
            mappings,
            luma,
            sequence: Sequence::default(),
            counts: Counts::default(),
            _manager: manager,
        })
    }

    fn wait(&mut self, until: Instant) -> Waited {
        self.next(until).unwrap_or_else(Waited::Lost)
    }

    fn frame(&self) -> Frame<'_> {
        let held = self.current.as_ref().expect("a wait has found a frame");
        let plane = self.mappings[held.buffer].bytes();
        let pixels = self.layout.pixels(plane, &self.luma);
        let Stamp { capture_time_ns, instant, ready_at } = held.completed.stamp;
        Frame {
            pixels: pixels.expect("its mapping was checked when the camera was opened"),
            capture_time_ns,
            instant,
            ready_at,
            late: held.late,
        }
    }

    fn counts(&self) -> Counts {
        self.counts
    }
}

impl Drop for Libcamera {
    fn drop(&mut self) {
        // Ends all requests while there is still an inbox to take them. A camera
        // that is gone refuses, and has none.
        let _ = self.camera.stop();
    }
}

impl std::fmt::Debug for Libcamera {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Libcamera")
            .field("camera", &self.camera.id())
            .field("layout", &self.layout)
            .field("counts", &self.counts)
            .finish_non_exhaustive()
    }
}

/// Maps a buffer's first plane: every format has its grey values there.
fn map_luma(buffer: &FrameBuffer) -> Result<Mapping> {
    let planes = buffer.planes();
    let plane = planes.get(0).context("it has no planes")?;
    let offset = plane.offset().context("its first plane is nowhere")?;
    Ok(Mapping::new(plane.fd(), offset, plane.len())?)
}
