//! A buffer that is written when its contents change, and made anew when it has to grow.

/// A small buffer from frame to frame.
#[derive(Debug)]
pub(crate) struct KeptBuffer {
    label: &'static str,
    usage: wgpu::BufferUsages,
    contents: Vec<u8>,
    buffer: Option<wgpu::Buffer>,
}

impl KeptBuffer {
    pub fn new(label: &'static str, usage: wgpu::BufferUsages) -> Self {
        Self { label, usage: usage | wgpu::BufferUsages::COPY_DST, contents: Vec::new(), buffer: None }
    }

    /// The buffer with these contents, which are a multiple of four bytes.
    pub fn with(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, contents: &[u8]) -> wgpu::Buffer {
        // A binding cannot be empty.
        let size = (contents.len() as u64).max(48);
        let known = self.buffer.take().filter(|buffer| buffer.size() >= size);
        let is_known = known.is_some() && self.contents == contents;
        let buffer = known.unwrap_or_else(|| {
            let (label, usage) = (Some(self.label), self.usage);
            device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
        });
        if !is_known {
            queue.write_buffer(&buffer, 0, contents);
            self.contents.clear();
            self.contents.extend_from_slice(contents);
        }
        self.buffer = Some(buffer.clone());
        buffer
    }
}
