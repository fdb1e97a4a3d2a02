// What is asked of the operating system about memory. Linux only: elsewhere there are no mappings,
// dropping does nothing, and nothing is known of what is in use.
#pragma once

#include <cstddef>
#include <string>

namespace nacre {

inline constexpr std::size_t kHugePage = std::size_t{1} << 21;

// `bytes` of a new file in `folder` that nobody else can see and that is gone with the mapping,
// whatever becomes of the process. Room on the disk is taken at once. Throws std::runtime_error,
// one line, if that fails; nothing is left then.
void* map_scratch_file(std::size_t bytes, const std::string& folder);
void unmap(void* first, std::size_t bytes);

// The pages that lie wholly in these bytes are not needed for now. Only for shared or read-only
// mappings of files, which hold the contents: memory would be lost.
void drop_pages(const void* first, std::size_t bytes);

// Asks for large pages, which are far quicker to come by. Only for memory.
void prefer_huge_pages(void* first, std::size_t bytes);

// Bytes of memory, files apart, that the process has in use; 0 if unknown.
std::size_t anonymous_memory();

}  // namespace nacre
