// The camera port on libcamera.
#include <libcamera/libcamera.h>
#include <linux/dma-buf.h>
#include <sys/ioctl.h>
#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <climits>
#include <cmath>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <vector>

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"
#include "firmware/ports/grey_conversion.h"

namespace finsight {

namespace {

// One being looked at, one ready, two being filled.
constexpr unsigned kBuffers = 4;
// A time stamp further back than this is of another clock.
constexpr std::int64_t kOldestNs = 2'000'000'000;

std::string quoted(const std::string& text) { return "\"" + text + "\""; }

/// The first plane of a buffer in our address space.
class MappedPlane {
 public:
  explicit MappedPlane(const libcamera::FrameBuffer::Plane& plane)
      : fd_(plane.fd.get()), offset_(plane.offset), bytes_(std::size_t{plane.offset} + plane.length) {
    start_ = mmap(nullptr, bytes_, PROT_READ, MAP_SHARED, fd_, 0);
    if (start_ == MAP_FAILED) throw InputError("camera", std::string("no access to a buffer: ") + std::strerror(errno));
  }
  ~MappedPlane() { munmap(start_, bytes_); }
  MappedPlane(const MappedPlane&) = delete;
  MappedPlane& operator=(const MappedPlane&) = delete;

  const std::uint8_t* pixels() const { return static_cast<const std::uint8_t*>(start_) + offset_; }
  std::size_t bytes() const { return bytes_ - offset_; }
  /// Around reading: the camera wrote past this processor's cache. Fails harmlessly on memory that needs no care.
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

/// Whether the camera takes this format and size just so.
bool fits(libcamera::CameraConfiguration& configuration, const libcamera::PixelFormat& format,
          const libcamera::Size& size) {
  libcamera::StreamConfiguration& stream = configuration.at(0);
  stream.pixelFormat = format;
  stream.size = size;
  stream.bufferCount = kBuffers;
  return configuration.validate() != libcamera::CameraConfiguration::Invalid && stream.pixelFormat == format &&
         stream.size == size;
}

/// Of the formats that hold grey levels at the wanted size, the cheapest. Nothing else is run instead.
void choose_mode(libcamera::CameraConfiguration& configuration, const LiveCameraSettings& settings) {
  const libcamera::Size size(static_cast<unsigned>(settings.width_px), static_cast<unsigned>(settings.height_px));
  const libcamera::StreamFormats offered = configuration.at(0).formats();
  std::optional<libcamera::PixelFormat> best;
  int best_rank = INT_MAX;
  std::string list;
  for (const libcamera::PixelFormat& format : offered.pixelformats()) {
    list += (list.empty() ? "" : ", ") + format.toString() + " " + offered.range(format).toString();
    const std::optional<GreyLayout> layout = grey_layout(format.fourcc());
    if (!layout || format.modifier() != 0 || layout->rank >= best_rank || !fits(configuration, format, size)) continue;
    best = format;
    best_rank = layout->rank;
  }
  if (!best || !fits(configuration, *best, size)) {
    throw InputError("source", "image size", list, "a grey, YUV or RGB format with " + size.toString());
  }
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

class LibcameraCamera : public Camera {
 public:
  explicit LibcameraCamera(const LiveCameraSettings& settings) : settings_(settings) {
    if (manager_.start() != 0) throw InputError("camera", "libcamera cannot look for cameras");
    try {
      open();
    } catch (...) {
      close();
      throw;
    }
  }
  ~LibcameraCamera() override { close(); }

  bool next(Frame& frame, int timeout_ms) override {
    if (shown_) give_back(shown_);
    shown_ = take_newest(timeout_ms);
    if (!shown_) return false;
    const MappedPlane& plane = *planes_[shown_->cookie()];
    plane.begin_read();
    frame = Frame{.grey = plane.pixels(),
                  .width_px = settings_.width_px,
                  .height_px = settings_.height_px,
                  .stride_bytes = stride_bytes_};
    if (!layout_.is_grey_plane()) {
      convert_to_grey(layout_, plane.pixels(), frame.width_px, frame.height_px, stride_bytes_, grey_.data());
      frame.grey = grey_.data();
      frame.stride_bytes = frame.width_px;
    }
    stamp(frame);
    return true;
  }

  bool ended() const override {
    const std::lock_guard lock(mutex_);
    return lost_ != nullptr;
  }
  std::string error() const override {
    const std::lock_guard lock(mutex_);
    return lost_ ? lost_ : "";
  }

 private:
  void open() {
    camera_ = find_camera(manager_, settings_.name);
    if (camera_->acquire() != 0) throw InputError("camera", label(*camera_) + " is in use by another program");
    const auto configuration = camera_->generateConfiguration({libcamera::StreamRole::VideoRecording});
    if (!configuration || configuration->empty()) throw InputError("camera", label(*camera_) + " gives no video");
    choose_mode(*configuration, settings_);
    const libcamera::StreamConfiguration& mode = configuration->at(0);
    if (camera_->configure(configuration.get()) != 0) throw InputError("camera", "refuses " + mode.toString());
    stream_ = mode.stream();
    stride_bytes_ = static_cast<int>(mode.stride);
    layout_ = *grey_layout(mode.pixelFormat.fourcc());
    if (!layout_.is_grey_plane()) {
      grey_.resize(static_cast<std::size_t>(settings_.width_px) * static_cast<std::size_t>(settings_.height_px));
    }
    make_requests();
    camera_->requestCompleted.connect(this, &LibcameraCamera::on_completed);
    camera_->disconnected.connect(this, &LibcameraCamera::on_disconnected);
    const libcamera::ControlList controls = choose_controls(*camera_, settings_);
    if (camera_->start(&controls) != 0) throw InputError("camera", label(*camera_) + " does not start");
    started_ = true;
    for (const auto& request : requests_) give_back(request.get());
  }

  void make_requests() {
    allocator_ = std::make_unique<libcamera::FrameBufferAllocator>(camera_);
    if (allocator_->allocate(stream_) <= 0) throw InputError("camera", "no memory for images");
    const std::size_t needed = static_cast<std::size_t>(stride_bytes_) * static_cast<std::size_t>(settings_.height_px);
    for (const auto& buffer : allocator_->buffers(stream_)) {
      planes_.push_back(std::make_unique<MappedPlane>(buffer->planes().front()));
      if (planes_.back()->bytes() < needed) throw InputError("camera", "its buffers are smaller than its images");
      requests_.push_back(camera_->createRequest(requests_.size()));
      if (!requests_.back() || requests_.back()->addBuffer(stream_, buffer.get()) != 0) {
        throw InputError("camera", "takes no requests");
      }
    }
    completed_.reserve(requests_.size());
    taken_.reserve(requests_.size());
  }

  void close() {
    if (shown_) planes_[shown_->cookie()]->end_read();
    if (started_) camera_->stop();
    if (camera_) {
      camera_->requestCompleted.disconnect(this);
      camera_->disconnected.disconnect(this);
    }
    requests_.clear();
    planes_.clear();
    allocator_.reset();
    if (camera_) camera_->release();
    camera_.reset();
    manager_.stop();
  }

  // The two handlers run in libcamera's thread.
  void on_completed(libcamera::Request* request) {
    const std::lock_guard lock(mutex_);
    if (request->status() == libcamera::Request::RequestCancelled) return;  // stopping, or unplugged
    completed_.push_back(request);
    arrived_.notify_one();
  }
  void on_disconnected() {
    const std::lock_guard lock(mutex_);
    lost_ = "it was unplugged";
    arrived_.notify_one();
  }

  /// The newest good frame. Older ones go back unseen: who comes late must not stay late. Their numbers are missing
  /// from the sequence, so they count as dropped.
  libcamera::Request* take_newest(int timeout_ms) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::milliseconds(timeout_ms);
    for (;;) {
      libcamera::Request* newest = nullptr;
      {
        std::unique_lock lock(mutex_);
        if (!arrived_.wait_until(lock, deadline, [this] { return lost_ || !completed_.empty(); }) || lost_) {
          return nullptr;
        }
        taken_.swap(completed_);
      }
      for (libcamera::Request* request : taken_) {
        libcamera::Request* unwanted = request;
        const libcamera::FrameMetadata* buffer = metadata_of(*request);
        const bool good = !buffer || buffer->status == libcamera::FrameMetadata::FrameSuccess;
        if (good) unwanted = std::exchange(newest, request);
        if (unwanted) requeue(unwanted);
      }
      taken_.clear();
      if (newest) return newest;
    }
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
    if (camera_->queueRequest(request) == 0) return;
    const std::lock_guard lock(mutex_);
    lost_ = "it takes no requests any more";
  }

  /// What the buffer says of its frame, if it was filled in, which the virtual camera does not do: then the two time
  /// stamps are the same.
  const libcamera::FrameMetadata* metadata_of(libcamera::Request& request) const {
    const libcamera::FrameMetadata& buffer = request.findBuffer(stream_)->metadata();
    const auto sensor_ns = request.metadata().get(libcamera::controls::SensorTimestamp);
    return sensor_ns && buffer.timestamp == static_cast<std::uint64_t>(*sensor_ns) ? &buffer : nullptr;
  }

  /// The sensor's time stamp is the start of the exposure. A buffer's sequence counts the sensor's frames, so that
  /// those that found no free buffer are missed; a request's counts only those that came too late for us.
  void stamp(Frame& frame) const {
    namespace controls = libcamera::controls;
    const libcamera::ControlList& metadata = shown_->metadata();
    const std::int64_t now = steady_now_ns();
    std::optional<std::int64_t> sensor_ns = metadata.get(controls::SensorTimestamp);
    if (sensor_ns && (*sensor_ns > now || *sensor_ns < now - kOldestNs)) sensor_ns.reset();
    const std::optional<std::int32_t> measured_us = metadata.get(controls::ExposureTime);
    const std::int64_t exposure_us = measured_us.value_or(settings_.exposure_us.value_or(0));
    frame.exposure_ns = std::min(sensor_ns.value_or(now) + exposure_us * 500, now);
    const libcamera::FrameMetadata* buffer = metadata_of(*shown_);
    frame.sequence = buffer ? buffer->sequence : shown_->sequence();
  }

  LiveCameraSettings settings_;
  libcamera::CameraManager manager_;
  std::shared_ptr<libcamera::Camera> camera_;
  libcamera::Stream* stream_ = nullptr;
  int stride_bytes_ = 0;
  GreyLayout layout_;
  std::vector<std::uint8_t> grey_;  // the converted image, for formats without a grey plane
  std::unique_ptr<libcamera::FrameBufferAllocator> allocator_;
  std::vector<std::unique_ptr<MappedPlane>> planes_;  // a request's cookie is its place here
  std::vector<std::unique_ptr<libcamera::Request>> requests_;
  bool started_ = false;
  libcamera::Request* shown_ = nullptr;  // what the last frame lies in

  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::vector<libcamera::Request*> completed_, taken_;
  const char* lost_ = nullptr;  // why
};

}  // namespace

std::unique_ptr<Camera> open_libcamera(const LiveCameraSettings& settings) {
  // What it says at every opening, and of the virtual camera at every frame, belongs to whoever asks for it.
  if (!std::getenv("LIBCAMERA_LOG_LEVELS")) {
    for (const char* category : {"Camera", "Formats", "IPAManager"}) libcamera::logSetLevel(category, "ERROR");
  }
  return std::make_unique<LibcameraCamera>(settings);
}

}  // namespace finsight
