// Where large tensors live when memory is bounded: in memory as long as they fit, else in files.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "nacre/tensor.hpp"

namespace nacre {

class Workspace {
  public:
    Workspace() : Workspace(0) {}

    // Bounds the anonymous memory of the process, what it has in use already included, to `bytes`
    // (0: no bound). `folder` is for the files, which nobody sees; empty: the system's for such.
    explicit Workspace(std::size_t bytes, std::string folder = {});

    // Uninitialised. In memory if it fits in what is left, else a shared mapping of a file (see
    // Tensor::drop). The room comes back when the tensor goes, which may be after the workspace
    // does. A copy of the tensor, or one that is reset to more than it holds, is in plain memory
    // that is not counted. Throws std::runtime_error if the disk has no room.
    Tensor tensor(Shape shape) const;

    // Keeps so many bytes of the room for what is not handed out here.
    void set_aside(std::size_t bytes) const;

    bool bounded() const { return bounded_; }
    std::size_t room() const;  // bytes that tensors in memory may still take

    // Kept for what is not handed out here: blocks, Gram matrices and BLAS buffers of the threads.
    static constexpr std::size_t kReserve = std::size_t{64} << 20;

  private:
    struct Room;
    bool bounded_;
    std::string folder_;
    std::shared_ptr<Room> room_;
};

}  // namespace nacre
