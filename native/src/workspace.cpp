#include "nacre/workspace.hpp"

#include <algorithm>
#include <filesystem>
#include <limits>
#include <mutex>

#include "nacre/errors.hpp"
#include "nacre/pages.hpp"

namespace nacre {

struct Workspace::Room {
    mutable std::mutex mutex;
    std::size_t bytes = std::numeric_limits<std::size_t>::max();

    bool take(std::size_t wanted) {
        const std::lock_guard lock(mutex);
        if (wanted > bytes) return false;
        bytes -= wanted;
        return true;
    }

    void give_back(std::size_t taken) {
        const std::lock_guard lock(mutex);
        bytes += taken;
    }
};

Workspace::Workspace(std::size_t bytes, std::string folder)
    : bounded_(bytes > 0), folder_(std::move(folder)), room_(std::make_shared<Room>()) {
    if (!bounded_) return;
#if !defined(__linux__)
    require(false, "memory: a bound is not supported on this system");
#endif
    const std::size_t used = anonymous_memory() + kReserve;
    room_->bytes = bytes > used ? bytes - used : 0;
    if (folder_.empty()) folder_ = std::filesystem::temp_directory_path().string();
}

std::size_t Workspace::room() const {
    const std::lock_guard lock(room_->mutex);
    return room_->bytes;
}

void Workspace::set_aside(std::size_t bytes) const {
    const std::lock_guard lock(room_->mutex);
    room_->bytes -= std::min(bytes, room_->bytes);
}

Tensor Workspace::tensor(Shape shape) const {
    const Index size = std::max<Index>(product(shape), 1);
    const std::size_t bytes = at(size) * sizeof(float);
    if (!bounded_) return Tensor(std::move(shape));
    if (!room_->take(bytes)) {
        auto* first = static_cast<float*>(map_scratch_file(bytes, folder_));
        return Tensor(std::move(shape), Buffer(first, size, {bytes, nullptr}));
    }
    // The room's own share keeps it alive for as long as there are tensors.
    const std::shared_ptr<void> lease(nullptr,
                                      [room = room_, bytes](void*) { room->give_back(bytes); });
    Buffer buffer(size);
    buffer.attach(lease);
    return Tensor(std::move(shape), std::move(buffer));
}

}  // namespace nacre
