// Drives the emulator with the maker's own client: pushes, reads the state back, prints its results.
use haply::device_model::{Force, ForceInput};
use haply::HaplyDevice;

#[tokio::main]
async fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let port = std::env::args().nth(1).expect("port");
    let mut device = HaplyDevice::new(&format!("http://127.0.0.1:{port}"), &format!("ws://127.0.0.1:{port}/")).await?;
    let mut seen = 0;
    for _ in 0..200 {
        tokio::time::sleep(std::time::Duration::from_millis(5)).await;
        let state = device.read_state().await?;
        let Some(first) = state.inverse3.first() else { continue };
        let p = first.state.cursor_position.ok_or("no cursor_position")?;
        let filters = first.config.as_ref().and_then(|c| c.filters.clone()).is_some();
        let grip = state.wireless_verse_grip.first().and_then(|g| g.state.orientation).is_some();
        seen += 1;
        if seen == 100 {
            println!("{} {} {:.4} {:.4} {:.4} calibrated {} filters {} grip {}", state.session_id, first.device_id, p.x, p.y, p.z, first.status.calibrated, filters, grip);
        }
        let push = ForceInput { device_id: first.device_id.clone(), forces: Force { x: 0.0, y: 0.0, z: 0.75 } };
        device.update_force(vec![push], Some(true), Some(true)).await?;
    }
    device.shutdown().await?;
    Ok(())
}
