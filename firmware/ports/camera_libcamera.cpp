// The camera port on libcamera.
#include <fcntl.h>
#include <libcamera/libcamera.h>
#include <linux/dma-buf.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <mutex>
#include <vector>

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"
#include "firmware/ports/camera_modes.h"
#include "firmware/ports/grey_conversion.h"
#include "firmware/ports/hand_over.h"
#include "firmware/ports/jpeg_decoder.h"

namespace finsight {

namespace {

// One in use, one ready, two being filled. A camera may insist on more.
constexpr unsigned kBuffers = 4, kMaxBuffers = 16;
// A time stamp further back than this is of another clock.
constexpr std::int64_t kOldestNs = 2'000'000'000;

std::string quoted(const std::string& text) { return "\"" + text + "\""; }

/// The first plane of a buffer, mapped into memory.
class MappedPlane {
 public:
  explicit MappedPlane(const libcamera::FrameBuffer::Plane& plane)
      : fd_(plane.fd.get()), offset_(plane.offset), bytes_(std::size_t{plane.offset} + plane.length) {
    start_ = mmap(nullptr, bytes_, PROT_READ, MAP_SHARED, fd_, 0);
    if (start_ == MAP_FAILED) throw InputError("camera", std::string("cannot map a buffer: ") + std::strerror(errno));
  }
  ~MappedPlane() { munmap(start_, bytes_); }
  MappedPlane(const MappedPlane&) = delete;
  MappedPlane& operator=(const MappedPlane&) = delete;

  const std::uint8_t* pixels() const { return static_cast<const std::uint8_t*>(start_) + offset_; }
  std::size_t bytes() const { return bytes_ - offset_; }
  /// Around reading: the camera writes past this processor's cache. Fails harmlessly on memory that needs no syncing.
  void begin_read() const { sync(DMA_BUF_SYNC_START); }
  void end_read() const { sync(DMA_BUF_SYNC_END); }

 private:
  void sync(std::uint64_t edge) const {
    dma_buf_sync request{edge | DMA_BUF_SYNC_READ};
    ioctl(fd_, DMA_BUF_IOCTL_SYNC, &request);
  }

  int fd_;
  std::size_t offset_, bytes_;
  void* start_;
};

std::string label(const libcamera::Camera& camera) {
  const auto model = camera.properties().get(libcamera::properties::Model);
  return quoted(camera.id()) + (model ? " (" + *model + ")" : "");
}

std::shared_ptr<libcamera::Camera> find_camera(libcamera::CameraManager& manager, const std::string& wanted) {
  std::vector<std::shared_ptr<libcamera::Camera>> found;
  std::string list;
  for (const auto& camera : manager.cameras()) {
    const std::string name = label(*camera);
    list += (list.empty() ? "" : ", ") + name;
    if (name.find(wanted) != std::string::npos) found.push_back(camera);
  }
  if (found.size() == 1) return found[0];
  throw InputError("source", "camera", list.empty() ? "no camera" : list,
                   (found.empty() ? "a name with " : "only one name with ") + quoted(wanted));
}

/// Whether the camera takes this format and size unchanged.
bool fits(libcamera::CameraConfiguration& configuration, const libcamera::PixelFormat& format,
          const libcamera::Size& size) {
  libcamera::StreamConfiguration& stream = configuration.at(0);
  stream.pixelFormat = format;
  stream.size = size;
  stream.bufferCount = kBuffers;
  return configuration.validate() != libcamera::CameraConfiguration::Invalid && stream.pixelFormat == format &&
         stream.size == size;
}

/// The fastest that a video device gives this format and size; 0: it does not tell.
double most_frames_per_second(int device, std::uint32_t v4l2, const libcamera::Size& size) {
  double most = 0;
  v4l2_frmivalenum interval{};
  interval.pixel_format = v4l2;
  interval.width = size.width;
  interval.height = size.height;
  for (; ioctl(device, VIDIOC_ENUM_FRAMEINTERVALS, &interval) == 0; ++interval.index) {
    const bool is_one = interval.type == V4L2_FRMIVAL_TYPE_DISCRETE;
    const v4l2_fract& shortest = is_one ? interval.discrete : interval.stepwise.min;
    if (shortest.numerator > 0) {
      most = std::max(most, static_cast<double>(shortest.denominator) / static_cast<double>(shortest.numerator));
    }
    if (!is_one) break;
  }
  return most;
}

/// Asks the kernel what libcamera 0.4 does not pass on.
double most_frames_per_second(const libcamera::Camera& camera, std::uint32_t v4l2, const libcamera::Size& size) {
  double most = 0;
  const auto numbers = camera.properties().get(libcamera::properties::SystemDevices);
  for (std::size_t i = 0; numbers && v4l2 != 0 && i < numbers->size(); ++i) {
    const auto number = static_cast<dev_t>((*numbers)[i]);
    const std::string path = "/dev/char/" + std::to_string(major(number)) + ":" + std::to_string(minor(number));
    const int device = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
    if (device < 0) continue;
    most = std::max(most, most_frames_per_second(device, v4l2, size));
    ::close(device);
  }
  return most;
}

/// Puts the format in which grey levels come best into the configuration, and says why it is that one. No other size
/// is accepted instead.
std::string choose_mode(const libcamera::Camera& camera, libcamera::CameraConfiguration& configuration,
                        const LiveCameraSettings& settings) {
  const libcamera::Size size(static_cast<unsigned>(settings.width_px), static_cast<unsigned>(settings.height_px));
  const libcamera::StreamFormats formats = configuration.at(0).formats();
  std::vector<OfferedFormat> usable;
  std::vector<libcamera::PixelFormat> usable_format;
  std::string list;
  for (const libcamera::PixelFormat& format : formats.pixelformats()) {
    list += (list.empty() ? "" : ", ") + format.toString() + " " + formats.range(format).toString();
    const std::optional<GreyLayout> layout = grey_layout(format.fourcc(), format.modifier());
    if (!layout || !fits(configuration, format, size)) continue;
    usable.push_back({format.toString(), *layout, most_frames_per_second(camera, layout->v4l2, size)});
    usable_format.push_back(format);
  }
  const std::optional<ChosenFormat> chosen = choose_format(usable, settings.frames_per_second);
  if (!chosen || !fits(configuration, usable_format[chosen->index], size)) {
    throw InputError("source", "image size", list, "a grey, YUV, RGB or MJPEG format with " + size.toString());
  }
  return chosen->why;
}

/// A control, checked against what this camera has.
template <class T, class Value>
void set_control(libcamera::ControlList& list, const libcamera::ControlInfoMap& offered,
                 const libcamera::Control<T>& control, Value value, const std::string& field) {
  const auto at = offered.find(&control);
  if (at == offered.end()) throw InputError("source", field, "a value", "none: this camera has no " + control.name());
  const libcamera::ControlInfo& info = at->second;
  const T lowest = info.min().get<T>(), highest = info.max().get<T>();
  if (value < lowest || value > highest) {
    throw InputError("source", field, std::to_string(value),
                     std::to_string(lowest) + " to " + std::to_string(highest) + " from this camera");
  }
  list.set(control, static_cast<T>(value));
}

libcamera::ControlList choose_controls(const libcamera::Camera& camera, const LiveCameraSettings& settings) {
  namespace controls = libcamera::controls;
  const libcamera::ControlInfoMap& offered = camera.controls();
  libcamera::ControlList list(offered);
  if (offered.count(&controls::FrameDurationLimits) > 0) {
    const std::int64_t frame_us = std::llround(1e6 / settings.frames_per_second);
    const std::array<std::int64_t, 2> limits{frame_us, frame_us};
    list.set(controls::FrameDurationLimits, libcamera::Span<const std::int64_t, 2>(limits));
  }
  const bool manual = settings.exposure_us || settings.gain;
  if (manual && offered.count(&controls::AeEnable) > 0) list.set(controls::AeEnable, false);
  if (settings.exposure_us) {
    set_control(list, offered, controls::ExposureTime, *settings.exposure_us, "exposure_us");
  }
  if (settings.gain) set_control(list, offered, controls::AnalogueGain, *settings.gain, "gain");
  return list;
}

/// The one manager that libcamera allows in a process; it runs while any finger has or opens a camera.
class ManagerInUse {
 public:
  ManagerInUse() {
    const std::lock_guard lock(mutex_);
    if (users_ == 0) {
      manager_ = std::make_unique<libcamera::CameraManager>();
      if (manager_->start() != 0) {
        manager_.reset();
        throw InputError("camera", "libcamera cannot look for cameras");
      }
    }
    ++users_;
  }
  ~ManagerInUse() {
    const std::lock_guard lock(mutex_);
    if (--users_ > 0) return;
    manager_->stop();
    manager_.reset();
  }
  ManagerInUse(const ManagerInUse&) = delete;
  ManagerInUse& operator=(const ManagerInUse&) = delete;
  libcamera::CameraManager& operator*() const { return *manager_; }

 private:
  inline static std::mutex mutex_;
  inline static int users_ = 0;
  inline static std::unique_ptr<libcamera::CameraManager> manager_;
};

class LibcameraCamera : public Camera {
 public:
  LibcameraCamera(const LiveCameraSettings& settings, const std::function<void(const std::string&)>& report)
      : settings_(settings) {
    try {
      report("camera: " + open());
    } catch (...) {
      close();
      throw;
    }
  }
  ~LibcameraCamera() override { close(); }

  bool next(Frame& frame, int timeout_ms) override {
    const auto limit = std::chrono::steady_clock::now() + std::chrono::milliseconds(timeout_ms);
    for (;;) {
      if (shown_) give_back(shown_);
      shown_ = take_newest(limit);
      if (!shown_) return false;
      if (show(frame)) return true;
      ++broken_;
    }
  }

  bool ended() const override { return events_->lost != nullptr; }
  std::string error() const override {
    const char* why = events_->lost;
    return why ? why : "";
  }
  CameraCounts counts() const override { return {.broken = broken_}; }

 private:
  /// False: the picture is broken.
  bool show(Frame& frame) {
    const MappedPlane& plane = *planes_[shown_->cookie()];
    plane.begin_read();
    frame = Frame{.grey = plane.pixels(),
                  .width_px = settings_.width_px,
                  .height_px = settings_.height_px,
                  .stride_bytes = stride_bytes_,
                  .coding = settings_.coding_or_linear()};
    if (!layout_.is_grey_plane()) {
      frame.grey = grey_.data();
      frame.stride_bytes = frame.width_px;
    }
    if (layout_.is_jpeg) {
      const JpegOutcome outcome =
          jpeg_.decode({plane.pixels(), used_bytes(plane)}, frame.width_px, frame.height_px, grey_.data());
      if (outcome != JpegOutcome::kDecoded) return false;
    } else if (!layout_.is_grey_plane()) {
      convert_to_grey(layout_, plane.pixels(), frame.width_px, frame.height_px, stride_bytes_, grey_.data());
    }
    stamp(frame);
    return true;
  }

  /// Of the buffer; 0 where the camera does not tell means all.
  std::size_t used_bytes(const MappedPlane& plane) const {
    const auto& planes = shown_->findBuffer(stream_)->metadata().planes();
    const std::size_t used = planes.empty() ? 0 : planes[0].bytesused;
    return used == 0 ? plane.bytes() : std::min(used, plane.bytes());
  }

  /// Says what was chosen.
  std::string open() {
    camera_ = find_camera(*manager_, settings_.name);
    if (camera_->acquire() != 0)
      throw InputError("camera", label(*camera_) + " is in use by another finger or program");
    const auto configuration = camera_->generateConfiguration({libcamera::StreamRole::VideoRecording});
    if (!configuration || configuration->empty()) throw InputError("camera", label(*camera_) + " gives no video");
    const std::string why = choose_mode(*camera_, *configuration, settings_);
    const libcamera::StreamConfiguration& mode = configuration->at(0);
    if (camera_->configure(configuration.get()) != 0) throw InputError("camera", "refuses " + mode.toString());
    stream_ = mode.stream();
    stride_bytes_ = static_cast<int>(mode.stride);
    layout_ = *grey_layout(mode.pixelFormat.fourcc(), mode.pixelFormat.modifier());
    if (!layout_.is_grey_plane()) {
      grey_.resize(static_cast<std::size_t>(settings_.width_px) * static_cast<std::size_t>(settings_.height_px));
    }
    make_requests();
    connect_events();
    const libcamera::ControlList controls = choose_controls(*camera_, settings_);
    if (camera_->start(&controls) != 0) throw InputError("camera", label(*camera_) + " does not start");
    started_ = true;
    for (const auto& request : requests_) give_back(request.get());
    return why;
  }

  void make_requests() {
    allocator_ = std::make_unique<libcamera::FrameBufferAllocator>(camera_);
    if (allocator_->allocate(stream_) <= 0) throw InputError("camera", "no memory for images");
    const std::size_t needed =
        layout_.is_jpeg ? 1 : static_cast<std::size_t>(stride_bytes_) * static_cast<std::size_t>(settings_.height_px);
    for (const auto& buffer : allocator_->buffers(stream_)) {
      if (requests_.size() == kMaxBuffers) break;  // it works with fewer than it has
      planes_.push_back(std::make_unique<MappedPlane>(buffer->planes().front()));
      if (planes_.back()->bytes() < needed) throw InputError("camera", "its buffers are smaller than its images");
      requests_.push_back(camera_->createRequest(requests_.size()));
      if (!requests_.back() || requests_.back()->addBuffer(stream_, buffer.get()) != 0) {
        throw InputError("camera", "takes no requests");
      }
    }
  }

  /// Releasing is done by libcamera's thread, after all that waits for it. From then on nothing there uses our requests
  /// and buffers, also of a camera that was unplugged, which stop() leaves as it is.
  void close() {
    if (shown_) planes_[shown_->cookie()]->end_read();
    if (started_) camera_->stop();
    if (camera_) camera_->release();
    requests_.clear();
    planes_.clear();
    allocator_.reset();
    camera_.reset();
  }

  /// What libcamera's thread tells. Its slots are never disconnected: it may be calling one at that moment. They keep
  /// what they write to and go with the camera, which that thread itself deletes.
  struct Events {
    HandOver<libcamera::Request*, kMaxBuffers> completed;
    std::atomic<const char*> lost{nullptr};  // why
  };

  void connect_events() {
    camera_->requestCompleted.connect(events_.get(), [events = events_](libcamera::Request* request) {
      // Cancelled: stopping, or unplugged. There is room for every request.
      if (request->status() != libcamera::Request::RequestCancelled) events->completed.put(request);
    });
    camera_->disconnected.connect(events_.get(), [events = events_] {
      events->lost = "it was unplugged";
      events->completed.wake();
    });
  }

  /// The newest good frame; null if there is none in time. Older ones are returned unused, so that a late caller does
  /// not stay late: their numbers are missing from the sequence, so they count as dropped.
  libcamera::Request* take_newest(std::chrono::steady_clock::time_point limit) {
    while (events_->completed.wait_until(limit) && !events_->lost) {
      libcamera::Request* newest = nullptr;
      while (const auto completed = events_->completed.take()) {
        libcamera::Request* unwanted = *completed;
        const libcamera::FrameMetadata* buffer = metadata_of(*unwanted);
        const bool good = !buffer || buffer->status == libcamera::FrameMetadata::FrameSuccess;
        if (good) unwanted = std::exchange(newest, unwanted);
        if (unwanted) requeue(unwanted);
      }
      if (newest) return newest;
    }
    return nullptr;
  }

  void give_back(libcamera::Request* request) {
    if (request == shown_) planes_[request->cookie()]->end_read();
    if (request == shown_) shown_ = nullptr;
    requeue(request);
  }

  void requeue(libcamera::Request* request) {
    if (request->status() != libcamera::Request::RequestPending) {
      request->reuse(libcamera::Request::ReuseBuffers);
    }
    if (camera_->queueRequest(request) != 0) events_->lost = "it takes no more requests";
  }

  /// The buffer's metadata, or null if the camera does not fill it in, as the virtual one: then its time stamp differs
  /// from the request's.
  const libcamera::FrameMetadata* metadata_of(libcamera::Request& request) const {
    const libcamera::FrameMetadata& buffer = request.findBuffer(stream_)->metadata();
    const auto sensor_ns = request.metadata().get(libcamera::controls::SensorTimestamp);
    return sensor_ns && buffer.timestamp == static_cast<std::uint64_t>(*sensor_ns) ? &buffer : nullptr;
  }

  /// The sensor's time stamp is the start of the first row's exposure. A buffer's sequence counts the sensor's frames,
  /// so that those that found no free buffer are missed; a request's counts only those that came too late for us.
  void stamp(Frame& frame) const {
    namespace controls = libcamera::controls;
    const libcamera::ControlList& metadata = shown_->metadata();
    const std::int64_t now = steady_now_ns();
    std::optional<std::int64_t> sensor_ns = metadata.get(controls::SensorTimestamp);
    if (sensor_ns && (*sensor_ns > now || *sensor_ns < now - kOldestNs)) sensor_ns.reset();
    const std::optional<std::int32_t> measured_us = metadata.get(controls::ExposureTime);
    const std::int64_t exposure_us = measured_us.value_or(settings_.exposure_us.value_or(0));
    const auto readout_ns = static_cast<std::int64_t>(settings_.readout_ms.value_or(0) * kNsPerMs);
    frame.exposure_ns = std::min(sensor_ns.value_or(now) + exposure_us * 500 + readout_ns / 2, now);
    const libcamera::FrameMetadata* buffer = metadata_of(*shown_);
    frame.sequence = buffer ? buffer->sequence : shown_->sequence();
  }

  LiveCameraSettings settings_;
  const ManagerInUse manager_;  // before the camera, which must not outlive it
  std::shared_ptr<libcamera::Camera> camera_;
  libcamera::Stream* stream_ = nullptr;
  int stride_bytes_ = 0;
  GreyLayout layout_;
  JpegDecoder jpeg_;
  std::uint32_t broken_ = 0;
  std::vector<std::uint8_t> grey_;  // the converted image, for formats without a grey plane
  std::unique_ptr<libcamera::FrameBufferAllocator> allocator_;
  std::vector<std::unique_ptr<MappedPlane>> planes_;  // a request's cookie is its place here
  std::vector<std::unique_ptr<libcamera::Request>> requests_;
  bool started_ = false;
  libcamera::Request* shown_ = nullptr;  // holds the last frame's image
  const std::shared_ptr<Events> events_ = std::make_shared<Events>();
};

}  // namespace

std::unique_ptr<Camera> open_libcamera(const LiveCameraSettings& settings,
                                       const std::function<void(const std::string&)>& report) {
  // Without this it writes to the log at every opening, and with the virtual camera at every frame.
  if (!std::getenv("LIBCAMERA_LOG_LEVELS")) {
    for (const char* category : {"Camera", "Formats", "IPAManager"}) libcamera::logSetLevel(category, "ERROR");
  }
  return std::make_unique<LibcameraCamera>(settings, report);
}

}  // namespace finsight
